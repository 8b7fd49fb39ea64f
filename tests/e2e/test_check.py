"""`goshawk-air check` says of each condition whether it holds and, if not, what to do."""

from __future__ import annotations

import contextlib
import json
import os
import platform
import subprocess
from pathlib import Path

import pytest
from rig import BIN, ROOT, VEHICLE, Rig, copied


def check(rig: Rig, *arguments: str | Path, wait_s: float) -> tuple[int, dict[str, dict[str, str]], str]:
    """Exit status, the conditions by their names, and what was printed."""
    figures = rig.folder / "check.json"
    command = [BIN / "goshawk-air", "check", "--listen", rig.endpoint, "--mavlink-bind",
               f"127.0.0.1:{rig.mavlink_port}", "--wait", wait_s, "--json", figures, *arguments]  # fmt: skip
    if "--log-dir" not in arguments:
        command += ["--log-dir", rig.logs]
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=60)
    found = json.loads(figures.read_text())
    assert (done.returncode == 0) == found["ready"], done.stdout + done.stderr
    return done.returncode, {c["name"]: c for c in found["conditions"]}, done.stdout


def test_with_everything_running_it_is_ready(rig: Rig) -> None:
    rig.sim("--seed", "5")
    status, found, printed = check(rig, "--config", VEHICLE, wait_s=30.0)
    assert status == 0, printed
    assert printed.strip().splitlines()[-1] == "ready"
    well = [
        "vehicle file", "onnx runtime", "policy", "provider", "inference", "log folder", "network", "autopilot",
        "battery", "clocks", "COM_OF_LOSS_T", "COM_OBL_RC_ACT", "camera", "odometry",
    ]  # fmt: skip
    for name in well:
        assert found[name]["level"] == "ok", found[name]
    assert found["real time"]["level"] in {"ok", "warning"}  # as the system permits
    assert "160 x 96" in found["camera"]["text"]


def test_without_anybody_each_missing_part_is_named(rig: Rig) -> None:
    status, found, printed = check(rig, "--config", VEHICLE, wait_s=0.5)
    assert status == 1
    assert "not ready: 3 of" in printed
    failed = {name for name, condition in found.items() if condition["level"] == "failed"}
    assert failed == {"autopilot", "camera", "odometry"}
    assert "MAVLink" in found["autopilot"]["text"]
    assert "in/rgbd" in found["camera"]["text"]


def test_a_policy_or_a_folder_that_is_not_there_is_named(rig: Rig) -> None:
    _, found, _ = check(rig, "--config", VEHICLE, "--policy", "no-such.onnx", "--log-dir", "/dev/null/x", wait_s=0.1)
    assert "no-such.onnx" in found["policy"]["text"]
    assert "/dev/null/x" in found["log folder"]["text"]
    assert found["policy"]["level"] == found["log folder"]["level"] == "failed"


def test_an_accelerator_that_is_not_there_leaves_the_processor_and_says_why(rig: Rig, tmp_path: Path) -> None:
    text = copied()
    config = tmp_path / "vehicle.toml"
    for provider in ["tensorrt", "cuda", "openvino"]:
        config.write_text(text.replace('provider = "cpu"', f'provider = "{provider}"'))
        _, found, _ = check(rig, "--config", config, wait_s=0.1)
        assert found["policy"]["level"] == "ok"
        assert found["provider"]["level"] == "warning", "this machine has one: look at what it says"
        assert "runs on cpu" in found["provider"]["text"]
        assert len(found["provider"]["text"]) > 60


def on_openvino(folder: Path, *, half: bool) -> Path:
    """The shipped vehicle file, with the network on OpenVINO."""
    library = ROOT / ".venv/openvino/onnxruntime/capi"
    asked = f'provider = "openvino"\nlibrary = "{library}"\nhalf_precision = {str(half).lower()}'
    config = folder / "vehicle.toml"
    config.write_text(copied().replace('provider = "cpu"', asked))
    return config


has_openvino = pytest.mark.skipif(platform.machine() != "x86_64", reason="there is no OpenVINO for this processor here")


@has_openvino
def test_openvino_answers_the_golden_images_in_32_and_in_16_bits(rig: Rig, tmp_path: Path) -> None:
    for half, told in ((False, "the network runs on openvino"), (True, "the network runs on openvino, in 16 bits")):
        _, found, _ = check(rig, "--config", on_openvino(tmp_path, half=half), wait_s=0.1)
        assert found["policy"]["level"] == found["inference"]["level"] == "ok", found
        assert (found["provider"]["level"], found["provider"]["text"]) == ("ok", told)


@has_openvino
@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="with one processor there is no other to run on")
def test_openvino_leaves_its_threads_on_whatever_processor_the_system_gives(tmp_path: Path) -> None:
    command = [BIN / "goshawk-sim", "fly", "--task", "track", "--speed", "3", "--trials", "1", "--seed", "3",
               "--vehicle-file", on_openvino(tmp_path, half=True)]  # fmt: skip
    seen: set[frozenset[int]] = set()
    flight = subprocess.Popen([str(c) for c in command], stdout=subprocess.DEVNULL)
    while flight.poll() is None:
        for thread in Path(f"/proc/{flight.pid}/task").iterdir():
            with contextlib.suppress(ProcessLookupError):
                seen.add(frozenset(os.sched_getaffinity(int(thread.name))))
    assert flight.returncode == 0
    assert seen == {frozenset(os.sched_getaffinity(0))}


def test_a_broken_vehicle_file_is_all_that_is_said(rig: Rig, tmp_path: Path) -> None:
    config = tmp_path / "vehicle.toml"
    config.write_text("name = 3\n")
    status, found, _ = check(rig, "--config", config, wait_s=0.1)
    assert status == 1
    assert list(found) == ["vehicle file"]


@pytest.mark.parametrize("name", ["micro-155", "x500"])
def test_a_reference_vehicle_takes_the_policy_that_it_names(rig: Rig, name: str) -> None:
    _, found, _ = check(rig, "--config", VEHICLE.with_name(f"{name}.toml"), wait_s=0.1)
    assert found["vehicle file"]["level"] == found["policy"]["level"] == "ok", found["policy"]
    assert found["tilt"]["level"] == "warning" and "25 degrees give 4.6 m/s²" in found["tilt"]["text"]
    assert "least distance" in found["tilt"]["text"] and "separation" not in found["tilt"]["text"]


def test_the_figures_are_told_though_their_file_cannot_be_written(rig: Rig, tmp_path: Path) -> None:
    command = [BIN / "goshawk-air", "check", "--config", VEHICLE, "--wait", "0.1", "--log-dir", tmp_path]
    done = subprocess.run([*map(str, command), "--json", "/nosuch/x.json"], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "vehicle file" in done.stdout and "cannot write /nosuch/x.json" in done.stderr


def test_a_vehicle_whose_camera_sees_less_than_its_policy_is_refused_and_told_what_to_do(
    rig: Rig, tmp_path: Path
) -> None:
    config = tmp_path / "vehicle.toml"
    config.write_text(copied().replace("hfov_deg = 90.0", "hfov_deg = 69.0"))
    _, found, _ = check(rig, "--config", config, wait_s=0.1)
    assert found["policy"]["level"] == "failed"
    assert "more than 0.5 degrees" in found["policy"]["text"] and "rim" in found["policy"]["text"]
