"""A campaign on a real Ray cluster of several nodes, one of which dies in the middle."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest
from command import goshawk
from lost_node import losing_a_node

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


def test_two_nodes_one_killed_in_the_middle_make_the_cells_of_one_machine(
    cluster: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    out = tmp_path / "ray"
    with losing_a_node(cluster, lambda: len(list((out / "units").glob("*.parquet")))) as done:
        run(out, "--engine", "ray", "--address", cluster.address)
    assert done and done[0] < 6, "the node died after the last flight"
    assert alive(cluster) and len(cluster.worker_nodes) == 1
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
