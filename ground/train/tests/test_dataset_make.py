"""`goshawk dataset make`: by many workers, the data set that one `goshawk-sim dataset` makes; killed, it goes on."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
from command import goshawk
from goshawk_train.data.layout import alone
from goshawk_train.data.made.make import RECIPE
from lost_node import losing_a_node

SIMULATOR = Path(__file__).parents[3] / "target" / "release" / "goshawk-sim"
GOSHAWK = [sys.executable, "-c", "from goshawk_ground.cli import main; main()"]
FRAMES = 2


def arguments(out: Path, scenes: int, *more: object) -> list[object]:
    size = ["--scenes", scenes, "--frames", FRAMES]
    return ["dataset", "make", "--out", out, *size, "--simulator", SIMULATOR, *more]


def whole(out: Path, scenes: int) -> dict[str, bytes]:
    """What one call of the simulator makes."""
    command = [SIMULATOR, "dataset", "--out", out, "--scenes", str(scenes), "--frames", str(FRAMES)]
    subprocess.run(command, check=True, capture_output=True)
    return files(out)


def files(root: Path) -> dict[str, bytes]:
    """By their names, hidden ones too; without the recipe, which one call of the simulator does not write."""
    found = {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}
    found.pop(RECIPE, None)
    return found


def test_units_by_two_workers_are_the_files_of_one_call_of_the_simulator(tmp_path: Path) -> None:
    made = goshawk(*arguments(tmp_path / "units", 3, "--workers", 2))
    assert made.exit_code == 0, made.output
    assert "3 scenes of 2 frames (3 new)" in made.stdout
    assert files(tmp_path / "units") == whole(tmp_path / "whole", 3)
    again = goshawk(*arguments(tmp_path / "units", 4))
    assert "4 scenes of 2 frames (1 new)" in again.stdout, "finished scenes are never made twice"
    assert files(tmp_path / "units") == whole(tmp_path / "whole", 4)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGKILL, -signal.SIGKILL)])
def test_an_ended_driver_loses_only_what_was_in_flight(number: signal.Signals, status: int, tmp_path: Path) -> None:
    out, scenes = tmp_path / "units", 8
    command = [*GOSHAWK, *arguments(out, scenes, "--workers", 1)]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen([*map(str, command)], stderr=subprocess.PIPE, text=True, env=environment) as driver:
        while not (finished := sorted(out.glob("scene_*"))):
            assert driver.poll() is None
            threading.Event().wait(0.02)
        driver.send_signal(number)
        _, words = driver.communicate()
    assert driver.returncode == status
    assert number == signal.SIGKILL or words.count("\n") == 1, words
    finished = sorted(out.glob("scene_*"))
    assert len(finished) < scenes, "it ended after the last scene"
    before = {scene: scene.stat().st_mtime_ns for scene in finished}
    again = goshawk(*arguments(out, scenes))
    assert f"({scenes - len(finished)} new)" in again.stdout, again.output
    assert before == {scene: scene.stat().st_mtime_ns for scene in finished}
    assert files(out) == whole(tmp_path / "whole", scenes)


def test_what_was_made_of_something_else_is_not_gone_on_with(tmp_path: Path) -> None:
    out = tmp_path / "units"
    assert goshawk(*arguments(out, 1)).exit_code == 0
    other = tmp_path / "goshawk-sim"
    other.write_bytes(SIMULATOR.read_bytes() + b"\0")
    for change, what in ((["--seed", 900_001], "seed"), (["--simulator", other], "goshawk-sim")):
        refused = goshawk(*arguments(out, 1), *change)
        assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1) and f"another {what}" in refused.stderr
    refused = goshawk(*arguments(tmp_path / "tables", 1, "--seed", 10_000_000))
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1) and "900000" in refused.stderr
    assert goshawk(*arguments(out, 2)).exit_code == 0
    refused = goshawk(*arguments(out, 1))
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1) and "begun with 2 scenes" in refused.stderr
    whole(tmp_path / "whole", 1)
    refused = goshawk(*arguments(tmp_path / "whole", 1))
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1) and RECIPE in refused.stderr


def test_two_at_once_are_kept_apart(tmp_path: Path) -> None:
    out = tmp_path / "units"
    with alone(out):
        refused = goshawk(*arguments(out, 1))
    assert (refused.exit_code, refused.stderr.count("\n")) == (
        2,
        1,
    ) and "another command fills it now" in refused.stderr
    assert list(out.iterdir()) == []
    assert goshawk(*arguments(out, 1)).exit_code == 0


def test_a_cluster_that_loses_a_node_makes_the_files_of_one_call_of_the_simulator(cluster: Any, tmp_path: Path) -> None:
    out, scenes = tmp_path / "units", 12
    with losing_a_node(cluster, lambda: len(list(out.glob("scene_*")))) as done:
        made = goshawk(*arguments(out, scenes, "--engine", "ray", "--address", cluster.address))
    assert made.exit_code == 0, made.output
    assert done and done[0] < scenes, "the node died after the last scene"
    assert files(out) == whole(tmp_path / "whole", scenes)


def test_an_address_without_ray_is_one_line(tmp_path: Path) -> None:
    refused = goshawk(*arguments(tmp_path / "units", 1, "--address", "auto"))
    assert refused.exit_code == 2 and "give --engine ray" in refused.stderr
