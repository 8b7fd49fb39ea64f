"""A campaign on a real Ray cluster of several nodes, one of which dies in the middle."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from typing import Any

import pytest
from command import goshawk

ROOT = Path(__file__).resolve().parents[3]
PLAN = """
trials = 15
seed = 5
seeds = "tuning"

[[row]]
name = "Navigation"
task = "navigate"
speeds = [8]
spacings = [5, 7]
options = ["--length", "10"]
"""


def run(out: Path, *arguments: object) -> None:
    path = out.with_suffix(".toml")
    path.write_text(PLAN)
    done = goshawk("campaign", "run", path, "--out", out, *arguments)
    assert done.exit_code == 0, done.output


def cells(out: Path) -> Any:
    return json.loads((out / "cells/navigation.json").read_text())["cells"]


@pytest.fixture
def cluster(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A head that flies nothing, and two nodes of one core each."""
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("RAY_worker_niceness", "0")
    from ray.cluster_utils import Cluster

    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    yield made
    made.shutdown()


def test_two_nodes_one_killed_in_the_middle_make_the_cells_of_one_machine(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    dies, lives = cluster.add_node(num_cpus=1), cluster.add_node(num_cpus=1)
    out = tmp_path / "ray"
    left: list[int] = []

    def kill_one_node() -> None:
        while not (units := list((out / "units").glob("*.parquet"))):
            dead.wait(0.02)
        cluster.remove_node(dies, allow_graceful=False)
        left.append(6 - len(units))

    dead = threading.Event()
    killer = threading.Thread(target=kill_one_node)
    killer.start()
    run(out, "--engine", "ray", "--address", cluster.address)
    killer.join()
    assert left[0] > 0, "the node died after the last flight"
    assert [node["NodeID"] for node in alive(cluster)] and lives in cluster.worker_nodes
    run(tmp_path / "local")
    assert cells(out) == cells(tmp_path / "local")
    assert sum(cell["trials"] for cell in cells(out)) == 30


def alive(cluster: Any) -> list[dict[str, Any]]:
    """The nodes that Ray still has."""
    import ray as typeless

    ray: Any = typeless
    ray.init(cluster.address, log_to_driver=False, logging_level="ERROR")
    try:
        return [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU")]
    finally:
        ray.shutdown()


def test_no_cluster_at_an_address_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    refused = goshawk("campaign", "run", path, "--address", "auto", "--out", tmp_path / "out")
    assert refused.exit_code == 2 and "give --engine ray" in refused.stderr
    assert os.environ.get("RAY_ADDRESS") is None
