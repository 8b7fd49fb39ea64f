"""Fixtures: the shipped configuration and a tiny synthetic data set."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from goshawk_train.config import Config, load_config
from synthetic import write_dataset

ROOT = Path(__file__).parents[1]
VECTORS = ROOT.parents[1] / "tests" / "vectors"


@pytest.fixture(scope="session")
def config() -> Config:
    return load_config(ROOT / "configs" / "track.toml")


@pytest.fixture(scope="session")
def navigate() -> Config:
    return load_config(ROOT / "configs" / "navigate.toml")


@pytest.fixture(scope="session")
def small(config: Config) -> Config:
    """A network and batches small enough for tests."""
    torch.set_num_threads(1)  # two that spin starve each other beside other work
    training = dataclasses.replace(
        config.training, batch=8, states=2, samples=8 * 40, validate_frames=16, learning_rate=2e-3
    )
    network = dataclasses.replace(config.network, channels=(8, 16, 32, 64), head_channels=32)
    return dataclasses.replace(config, training=training, network=network)


@pytest.fixture(scope="session")
def dataset(tmp_path_factory: pytest.TempPathFactory, config: Config) -> Path:
    root = tmp_path_factory.mktemp("data") / "synthetic"
    write_dataset(root, config.camera, scenes=2, frames=12, seed=3)
    return root


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Ray: a head that does no work, and two nodes of one core each."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_worker_niceness", "0")
    monkeypatch.setenv("RAY_gcs_server_request_timeout_seconds", "30")  # on a machine that has other work
    from ray.cluster_utils import Cluster

    made: Any = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    for _ in range(2):
        made.add_node(num_cpus=1)
    yield made
    made.shutdown()
