"""Each bad input gives one clear line and a non-zero exit, or a stated reason for not being ready. Never a panic."""

from __future__ import annotations

import socket
import subprocess
from pathlib import Path

import pytest
from rig import BIN, VEHICLE, Rig, copied


def refused(*command: str | Path) -> str:
    """The single line that the command leaves on stderr; it must exit non-zero by itself."""
    done = subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=60)
    assert done.returncode not in (0, 101), done.stderr
    assert "panicked" not in done.stderr
    lines = [line for line in done.stderr.splitlines() if line.strip()]
    assert len(lines) == 1, done.stderr
    return lines[0]


def air(*arguments: str | Path) -> str:
    return refused(BIN / "goshawk-air", "run", *arguments)


def edited(tmp_path: Path, old: str, new: str) -> Path:
    text = copied()
    assert old in text
    path = tmp_path / "vehicle.toml"
    path.write_text(text.replace(old, new))
    return path


def test_an_unknown_config_key_is_named_with_its_line(tmp_path: Path) -> None:
    line = air("--config", edited(tmp_path, "mass_kg", "mass_lb"))
    assert "mass_lb" in line
    assert "line " in line


def test_a_missing_vehicle_file_is_named() -> None:
    assert "nowhere.toml" in air("--config", "nowhere.toml")


def test_a_missing_model_is_named() -> None:
    assert "no-such.onnx" in air("--config", VEHICLE, "--policy", "no-such.onnx")


def test_a_file_that_is_no_model_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "noise.onnx"
    path.write_bytes(bytes(range(256)) * 16)
    assert "noise.onnx" in air("--config", VEHICLE, "--policy", path)


def test_a_model_without_a_contract_is_refused(tmp_path: Path) -> None:
    import onnx
    from onnx import TensorProto, helper

    value = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1])
    out = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1])
    graph = helper.make_graph([helper.make_node("Identity", ["x"], ["y"])], "g", [value], [out])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    path = tmp_path / "bare.onnx"
    onnx.save(model, path)
    assert "contract" in air("--config", VEHICLE, "--policy", path)


def test_a_contract_of_another_task_is_refused(tmp_path: Path) -> None:
    config = edited(tmp_path, 'task = "track"', 'task = "navigate"\ngoal_m = [40.0, 0.0, 0.0]')
    assert "chase" in air("--config", config)


def test_a_mavlink_port_in_use_is_named(rig: Rig) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", rig.mavlink_port))
        line = air("--config", VEHICLE, "--listen", rig.endpoint, "--mavlink-bind", f"127.0.0.1:{rig.mavlink_port}")
    assert str(rig.mavlink_port) in line
    assert "in use" in line


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("udpin:127.0.0.1:14540", "tcpout:127.0.0.1:5760", "udpin:ADDRESS:PORT"),
        ('firmware = "px4"', 'firmware = "ardupilot"', "the simulated autopilot is a PX4"),
    ],
)
def test_the_simulated_autopilot_says_what_it_cannot_be(
    rig: Rig, tmp_path: Path, old: str, new: str, told: str
) -> None:
    config = edited(tmp_path, old, new)
    assert told in refused(BIN / "goshawk-sim", "serve", "--vehicle-file", config, "--connect", rig.endpoint)


def test_a_zenoh_port_in_use_is_named(rig: Rig) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", rig.zenoh_port))
        taken.listen()
        line = air("--config", VEHICLE, "--listen", rig.endpoint, "--mavlink-bind", f"127.0.0.1:{rig.mavlink_port}")
    assert str(rig.zenoh_port) in line


@pytest.mark.parametrize("arguments", [[], ["fly-away"], ["run"], ["run", "--config"]])
def test_a_wrong_command_line_leads_to_the_usage(arguments: list[str]) -> None:
    done = subprocess.run([BIN / "goshawk-air", *arguments], capture_output=True, text=True, timeout=20)
    assert done.returncode == 2
    assert "Usage" in done.stderr or "try '--help'" in done.stderr


def test_without_camera_and_autopilot_it_is_not_ready_and_says_why(rig: Rig) -> None:
    rig.air()
    with rig.link() as link:
        snap = link.wait_for(lambda s: s.health is not None, 20.0)
        assert snap is not None and snap.health is not None, rig.output("air")
        reasons = {check.name: check.reason for check in snap.health.checks if not check.ok}
        assert not snap.health.ready
        assert {"camera", "odometry", "autopilot", "policy"} <= set(reasons)
        assert "MAVLink" in reasons["autopilot"]
        assert all(reasons.values())
        reply = link.start()
        assert reply.answered
        assert not reply.accepted
        assert "not ready" in reply.text
        unknown = link.start("no-such-profile")
        assert not unknown.accepted
        assert "chase" in unknown.text
    assert "panicked" not in rig.output("air")
