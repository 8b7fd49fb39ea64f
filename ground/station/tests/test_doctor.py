"""`goshawk doctor`: each line says how a thing is, and what to do about it."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from goshawk_ground.cli import app
from goshawk_ground.doctor import ground, vehicle
from goshawk_ground.doctor.findings import Finding, State
from goshawk_ground.doctor.link import LinkFacts, link_findings
from goshawk_ground.doctor.programs import AIR, SIM
from goshawk_ground.doctor.roles import Role, local_findings
from goshawk_ground.pages.ports import is_free
from typer.testing import CliRunner

Fakes = Callable[..., Any]


def facts(**changes: Any) -> LinkFacts:
    """A good link."""
    good: dict[str, Any] = {
        "connect": "tcp/kite:7447", "vehicle": "kite", "reachable": True, "round_trips_ms": (0.4, 0.6, 9.0),
        "clock_offset_ms": -1500.0, "version": "0.1.0",
    }  # fmt: skip
    return LinkFacts(**{**good, **changes})


def by_name(findings: list[Finding]) -> dict[str, Finding]:
    return {finding.name: finding for finding in findings}


def all_free(port: int, *, udp: bool) -> bool:
    return True


def all_but_the_dashboards_free(port: int, *, udp: bool) -> bool:
    return port != 8080


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A source tree with both programs built after their source, and a wheel of ONNX Runtime."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    monkeypatch.setattr(ground, "is_free", all_free)
    (tmp_path / "air/vehicles").mkdir(parents=True)
    (tmp_path / "air/main.rs").write_text("fn main() {}")
    (tmp_path / "bin").mkdir()
    for name in (AIR, SIM):
        program = tmp_path / "bin" / name
        program.write_text(f"#!/bin/sh\necho {name} 9.9\n")
        program.chmod(0o755)
    library = tmp_path / ".venv/lib/python3.11/site-packages/onnxruntime/capi/libonnxruntime.so.1.31.1"
    library.parent.mkdir(parents=True)
    library.touch()
    subprocess.run(["git", "init", "-q", "."], check=True)
    return tmp_path


@pytest.mark.parametrize("role", Role)
def test_every_line_that_is_not_ok_says_what_to_do(tree: Path, role: Role) -> None:
    for name in (AIR, SIM):
        (tree / "bin" / name).unlink()
    findings = [*local_findings(role, tree / "bin"), *link_findings(facts(reachable=False), "0.1.0")]
    assert {finding.state for finding in findings} >= {State.OK, State.BAD}
    assert all(bool(finding.todo) == (finding.state is not State.OK) for finding in findings)


def test_why_nobody_answers_is_told_as_far_as_it_is_known() -> None:
    problem = "kite is vehicle.hawk, not vehicle.kite: check --vehicle"
    (finding,) = link_findings(facts(reachable=False, problem=problem), "0.1.0")
    assert finding.text == f"nobody answers at tcp/kite:7447: {problem}"


def test_an_editors_lock_is_no_source(tree: Path) -> None:
    (tree / "air/.#main.rs").symlink_to("somebody@somewhere.1:2")
    assert by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))[AIR].state is State.OK


def test_programs_are_run_for_their_version(tree: Path) -> None:
    found = by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))
    assert found["goshawk-air"].state is State.OK
    assert "goshawk-air 9.9" in found["goshawk-air"].text


def test_a_program_older_than_its_source_is_told(tree: Path) -> None:
    source = tree / "air/main.rs"
    newest = (tree / "bin/goshawk-air").stat().st_mtime + 10
    import os

    os.utime(source, (newest, newest))
    found = by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))
    assert found["goshawk-air"].state is State.NOTE
    assert "air/main.rs" in found["goshawk-air"].text


def test_a_missing_or_broken_program_is_broken(tree: Path) -> None:
    (tree / "bin/goshawk-air").unlink()
    (tree / "bin/goshawk-sim").write_text("#!/bin/sh\nexit 3\n")
    found = by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))
    assert (found["goshawk-air"].state, found["goshawk-sim"].state) == (State.BAD, State.BAD)
    assert "make build" in found["goshawk-air"].todo


def test_a_laptop_without_the_programs_is_well_and_a_vehicle_is_not(tree: Path) -> None:
    (tree / "bin/goshawk-air").unlink()
    laptop = by_name(list(local_findings(Role.LAPTOP, tree / "bin")))
    on_vehicle = by_name(list(local_findings(Role.VEHICLE, tree / "bin")))
    assert (laptop["goshawk-air"].state, on_vehicle["goshawk-air"].state) == (State.NOTE, State.BAD)
    assert "goshawk-sim" not in on_vehicle and "ONNX Runtime" not in laptop


def test_a_linked_program_has_its_library_beside_what_it_is_linked_to(tree: Path) -> None:
    (tree / "lib").mkdir()
    (tree / "bin/goshawk-air").rename(tree / "lib/goshawk-air")
    (tree / "bin/goshawk-air").symlink_to("../lib/goshawk-air")
    (tree / "lib/libonnxruntime.so").touch()
    found = by_name(list(local_findings(Role.LAPTOP, tree / "bin")))
    assert found["ONNX Runtime"].text == str(tree / "lib/libonnxruntime.so")


@pytest.mark.parametrize(
    ("governors", "state"),
    [((), State.OK), (("performance",) * 2, State.OK), (("performance", "schedutil"), State.NOTE)],
)
def test_a_vehicles_processor_keeps_its_clock(tree: Path, governors: tuple[str, ...], state: State) -> None:
    for number, governor in enumerate(governors):
        file = tree / f"sys/devices/system/cpu/cpu{number}/cpufreq/scaling_governor"
        file.parent.mkdir(parents=True)
        file.write_text(f"{governor}\n")
    assert by_name(list(vehicle.computer(tree / "bin", tree)))["processor"].state is state


@pytest.mark.parametrize(
    ("has", "state", "words"),
    [
        (None, State.NOTE, "no goshawk-camera is here"),
        ("", State.NOTE, "has no librealsense"),
        ("pyrealsense2", State.OK, "with librealsense;"),
        ("depthai", State.OK, "with depthai;"),
        ("pyrealsense2 depthai", State.OK, "with librealsense and depthai;"),
    ],
)
def test_a_vehicles_camera_driver_and_its_library_are_looked_for(
    tree: Path, monkeypatch: pytest.MonkeyPatch, has: str | None, state: State, words: str
) -> None:
    monkeypatch.setattr(sys, "executable", str(tree / "none/python"))
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    if has is not None:
        programs = tree / ".venv/bin"
        programs.mkdir()
        (programs / "goshawk-camera").touch()
        fits = " | ".join(f'*"import {package}"*' for package in ("nothing", *has.split()))
        (programs / "python").write_text(f'#!/bin/sh\ncase "$*" in {fits}) exit 0 ;; esac; exit 1\n')
        (programs / "python").chmod(0o755)
    camera = by_name(list(vehicle.computer(tree / "bin", tree)))["camera"]
    assert camera.state is state and words in camera.text
    assert bool(camera.todo) == (state is State.NOTE)


def dialout(name: str) -> SimpleNamespace:
    return SimpleNamespace(gr_gid=20)


@pytest.mark.parametrize(
    ("user", "groups", "state"),
    [(0, [], State.OK), (1000, [20], State.OK), (1000, [1000], State.NOTE)],
    ids=["root", "member", "stranger"],
)
def test_a_vehicles_user_may_open_serial_ports(
    tree: Path, monkeypatch: pytest.MonkeyPatch, user: int, groups: list[int], state: State
) -> None:
    monkeypatch.setattr(vehicle.os, "geteuid", lambda: user)
    monkeypatch.setattr(vehicle.os, "getgroups", lambda: groups)
    monkeypatch.setattr(vehicle.grp, "getgrnam", dialout)
    ports = by_name(list(vehicle.computer(tree / "bin", tree)))["serial ports"]
    assert ports.state is state and ("usermod -aG dialout" in ports.todo) == (state is State.NOTE)


def test_a_vehicle_needs_its_vehicle_file(tree: Path) -> None:
    assert by_name(list(vehicle.computer(tree / "bin", tree)))["vehicle file"].state is State.NOTE
    (tree / "etc/goshawk").mkdir(parents=True)
    (tree / "etc/goshawk/vehicle.toml").touch()
    assert by_name(list(vehicle.computer(tree / "bin", tree)))["vehicle file"].state is State.OK


def test_onnx_runtime_is_looked_for_where_the_vehicle_looks(tree: Path) -> None:
    assert by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))["ONNX Runtime"].state is State.OK
    (library,) = tree.glob(".venv/lib/*/site-packages/onnxruntime/capi/*")
    library.rename(tree / "bin/libonnxruntime.so")
    assert by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))["ONNX Runtime"].text == str(
        tree / "bin/libonnxruntime.so"
    )
    (tree / "bin/libonnxruntime.so").unlink()
    assert by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))["ONNX Runtime"].state is State.BAD


def test_a_busy_port_is_a_note(tree: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ground, "is_free", all_but_the_dashboards_free)
    found = by_name(list(local_findings(Role.DEVELOPER, tree / "bin")))
    assert found["port 8080/tcp"].state is State.NOTE
    assert found["port 14540/udp"].state is State.OK


def test_the_link_is_told_from_its_facts() -> None:
    found = by_name(list(link_findings(facts(), "0.1.0")))
    assert {finding.state for finding in found.values()} == {State.OK}
    assert "median 0.6 ms, max 9.0 ms of 3" in found["round trip"].text
    assert "1.5000 s behind" in found["clock"].text


@pytest.mark.parametrize(
    ("changes", "name", "state", "words"),
    [
        ({"reachable": False}, "link", State.BAD, "--connect"),
        ({"round_trips_ms": ()}, "link", State.BAD, "--vehicle"),
        ({"round_trips_ms": (250.0,)}, "round trip", State.NOTE, "band"),
        ({"clock_offset_ms": None}, "clock", State.NOTE, "goshawk status"),
        ({"version": "0.0.9"}, "version", State.NOTE, "same revision"),
    ],
)
def test_what_is_wrong_with_the_link_says_what_to_do(
    changes: dict[str, Any], name: str, state: State, words: str
) -> None:
    found = by_name(list(link_findings(facts(**changes), "0.1.0")))
    assert found[name].state is state
    assert words in found[name].todo


def test_a_vehicle_is_reached_measured_and_not_commanded(fake_vehicle: Fakes) -> None:
    endpoint = fake_vehicle().endpoint
    done = CliRunner().invoke(app, ["doctor", "--connect", endpoint, "--timeout", "10", "--json"])
    told = {f["name"]: f for f in json.loads(done.stdout)["findings"]}
    assert told["link"]["state"] == "ok"
    assert told["round trip"]["state"] in ("ok", "note")
    assert "this machine's" in told["clock"]["text"]
    assert told["version"]["text"].startswith("the vehicle's is 0.1.0-fake")
    status = CliRunner().invoke(app, ["status", "--connect", endpoint, "--json"])
    assert json.loads(status.stdout)["mode"] in ("idle", "ready")


def test_no_vehicle_is_broken_unless_it_is_left_out(free_endpoint: str, tree: Path) -> None:
    there = CliRunner().invoke(app, ["doctor", "--connect", free_endpoint, "--timeout", "0.5", "--bin-dir", "bin"])
    assert there.exit_code == 1
    assert "nobody answers" in there.stdout
    left_out = CliRunner().invoke(app, ["doctor", "--offline", "--bin-dir", "bin", "--json"])
    facts = json.loads(left_out.stdout)
    assert (left_out.exit_code, facts["ok"]) == (0, True)
    assert "link" not in {f["name"] for f in facts["findings"]}


def test_a_bad_endpoint_is_one_clear_line() -> None:
    done = CliRunner().invoke(app, ["doctor", "--connect", "nonsense"])
    assert done.exit_code == 2
    assert "'nonsense' is not an endpoint" in done.stderr


def test_a_port_in_use_is_seen() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        assert not is_free(taken.getsockname()[1])


@pytest.mark.parametrize(
    ("shell", "words", "expected"),
    [
        ("bash", "goshawk d", "doctor"),
        ("bash", "goshawk export x --format ", "foxglove"),
        ("zsh", "goshawk rep", "report"),
    ],
)
def test_the_shell_completes_commands_and_values(shell: str, words: str, expected: str) -> None:
    import os

    program = Path(sys.executable).with_name("goshawk")
    position = str(len(words.split(" ")) - 1)
    environment = {
        **os.environ,
        "_GOSHAWK_COMPLETE": f"complete_{shell}",
        "COMP_WORDS": words,
        "COMP_CWORD": position,
        "_TYPER_COMPLETE_ARGS": words,
    }
    done = subprocess.run([program], env=environment, capture_output=True, text=True, timeout=300, check=False)
    assert expected in done.stdout


def test_the_help_names_what_shows_and_installs_completion() -> None:
    text = CliRunner().invoke(app, ["--help"]).stdout
    assert "--install-completion" in text and "--show-completion" in text
