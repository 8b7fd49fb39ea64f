"""The demo as a process, with stand-ins for the two binaries: it flies, judges, and cleans up."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest
from goshawk_ground.cli import app
from goshawk_ground.demo import places
from goshawk_ground.demo.children import Child, stop_all
from goshawk_ground.demo.run import DemoOptions, fly_on
from goshawk_ground.link import GroundLink
from goshawk_ground.pages.ports import free_port
from goshawk_proto import goshawk_pb2 as pb
from rich.console import Console
from typer.testing import CliRunner

ROOT = Path(__file__).resolve().parents[3]
FAKE = ROOT / "tests/browser/fake_vehicle.py"
SLEEPER = "#!/bin/sh\nexec sleep 600\n"
OF_TEST = "GOSHAWK_DEMO_OF_TEST"
"""What a demo and all that it starts carry in their environment."""


def stand_ins(folder: Path, *, air: str, sim: str = SLEEPER) -> Path:
    """A folder with the two binaries as scripts."""
    folder.mkdir()
    for name, script in (("goshawk-air", air), ("goshawk-sim", sim)):
        (folder / name).write_text(script)
        (folder / name).chmod(0o755)
    return folder


def flying_air(*flags: str) -> str:
    """A goshawk-air that is the stand-in vehicle at the endpoint it was given."""
    return f'#!/bin/sh\nexec {sys.executable} {FAKE} --listen "$5" --identity "$9" {" ".join(flags)}\n'


def demo(folder: Path, bin_dir: Path, *arguments: str, temporary: str = "/tmp") -> subprocess.Popen[str]:
    command = [
        sys.executable, "-c", "from goshawk_ground.cli import main; main()", "demo", "--bin-dir", str(bin_dir),
        "--log-dir", str(folder / "logs"), *arguments,
    ]  # fmt: skip
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=ROOT,
        env={**os.environ, "COLUMNS": "200", "TMPDIR": temporary, OF_TEST: str(folder)},
    )


def descendants(folder: Path) -> list[str]:
    """The command lines of what runs of a test's demo."""
    found: list[str] = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                if f"{OF_TEST}={folder}".encode() in (entry / "environ").read_bytes().split(b"\0"):
                    found.append((entry / "cmdline").read_bytes().decode(errors="replace"))
            except OSError:
                continue
    return found


def test_a_headless_demo_flies_and_succeeds(tmp_path: Path) -> None:
    bin_dir = stand_ins(tmp_path / "bin", air=flying_air())
    process = demo(tmp_path, bin_dir, "--headless", "--distance", "8", "--json", str(tmp_path / "out.json"))
    output, _ = process.communicate(timeout=90)
    assert process.returncode == 0, output
    assert "flight" in output
    assert "succeeded" in output
    facts = json.loads((tmp_path / "out.json").read_text())
    assert facts["succeeded"] is True
    assert facts["target_path_m"] >= 8.0
    assert facts["collisions"] == 0
    assert facts["planner_hz"] > 50
    assert not descendants(tmp_path)


def test_where_the_second_program_cannot_run_the_first_is_stopped(tmp_path: Path) -> None:
    bin_dir = stand_ins(tmp_path / "bin", air=SLEEPER, sim="no program")
    output, _ = demo(tmp_path, bin_dir, "--headless").communicate(timeout=60)
    assert "Exec format error" in output and "Traceback" not in output
    assert not descendants(tmp_path)


def test_a_verdict_that_could_not_be_kept_is_refused_before_the_flight(tmp_path: Path) -> None:
    bin_dir = stand_ins(tmp_path / "bin", air=SLEEPER)
    process = demo(tmp_path, bin_dir, "--headless", "--json", str(tmp_path / "nowhere/out.json"))
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1 and len(output.splitlines()) == 1
    assert f"{tmp_path / 'nowhere'} is no folder" in output


def test_each_start_after_the_demos_own_flight_is_judged(tmp_path: Path) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port(17700)}"
    options = DemoOptions(
        seed=1, navigate=False, headless=False, speed_mps=3.0, spacing_m=5.0, distance_m=3.0, port=0,
        bin_dir=tmp_path, log_dir=tmp_path, json_file=None,
    )  # fmt: skip
    vehicle = Child("air", [sys.executable, str(FAKE), "--listen", endpoint], tmp_path / "air.log")
    said, ended = io.StringIO(), threading.Event()
    with GroundLink(connect=endpoint) as link:
        console = Console(file=said, width=200)
        judge = threading.Thread(target=fly_on, args=(options, link, [vehicle], console, ended))
        judge.start()

        def fly(*, until: str, stop: bool = False) -> None:
            assert link.wait_for(lambda s: s.mode in (pb.MODE_READY, pb.MODE_LANDED), 20) is not None
            assert link.start().accepted
            assert link.wait_for(lambda s: s.mode == pb.MODE_TRACK, 20) is not None
            if stop:
                link.press_stop()
            assert link.wait_for(lambda _: until in said.getvalue(), 20) is not None, said.getvalue()

        try:
            fly(until="succeeded")
            fly(until="failed: it was stopped; the target had run", stop=True)
            assert "the end of" not in said.getvalue(), "nothing is wrong with what was stopped"
        finally:
            ended.set()
            stop_all([vehicle])
            judge.join()


def test_the_goal_of_a_navigation_is_the_vehicle_files() -> None:
    assert places.goal_of(ROOT / "air/vehicles/navigate.toml") == (90.0, 5.0)


def test_a_navigation_takes_no_options_of_a_chase() -> None:
    done = CliRunner().invoke(app, ["demo", "--task", "navigate", "--speed", "4"])
    assert done.exit_code == 1
    assert done.output.startswith("goshawk: --task navigate: leave out --speed")


def test_a_simulator_that_dies_is_a_failure_with_its_last_words(tmp_path: Path) -> None:
    sim = "#!/bin/sh\nsleep 2\necho the world ended >&2\nexit 7\n"
    bin_dir = stand_ins(tmp_path / "bin", air=flying_air("--not-ready"), sim=sim)
    process = demo(tmp_path, bin_dir, "--headless")
    output, _ = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "sim ended by itself (status 7)" in output
    assert "the world ended" in output
    assert not descendants(tmp_path)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupted_demo_leaves_nothing_running_nor_lying_about(tmp_path: Path, number: signal.Signals) -> None:
    sim = "#!/bin/sh\nexec sh -c 'sleep 600; :'\n"
    binaries = stand_ins(tmp_path / "bin", air=flying_air("--not-ready"), sim=sim)
    with tempfile.TemporaryDirectory() as temporary:  # of a short name, for sockets
        process = demo(tmp_path, binaries, "--headless", temporary=temporary)
        deadline = time.monotonic() + 30
        while not all(any(name in command for command in descendants(tmp_path)) for name in ("sleep", FAKE.name)):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        assert list(Path(temporary).iterdir()), "nothing was written that could be left"
        process.send_signal(number)
        output, _ = process.communicate(timeout=30)
        assert process.returncode == 1, output
        assert "Traceback" not in output
        assert not descendants(tmp_path)
        assert not list(Path(temporary).iterdir())


def test_missing_binaries_are_one_clear_line(tmp_path: Path) -> None:
    process = demo(tmp_path, tmp_path / "nowhere", "--headless")
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 1
    assert output.strip().splitlines()[-1].startswith("goshawk: ")
    assert "make setup" in output and "the package goshawk-sim" in output


@pytest.mark.parametrize(("flag", "firmware"), [("--px4", "PX4"), ("--ardupilot", "ArduPilot")])
def test_firmware_that_is_not_there_is_one_clear_line_before_anything_starts(
    tmp_path: Path, flag: str, firmware: str
) -> None:
    binaries, logs = stand_ins(tmp_path / "bin", air=flying_air("--not-ready")), tmp_path / "logs"
    file = tmp_path / "file"
    file.touch()
    for folder, what in ((tmp_path / "none", "does not exist"), (file, "is not a folder")):
        process = demo(tmp_path, binaries, "--headless", flag, str(folder))
        output, _ = process.communicate(timeout=30)
        assert process.returncode == 1
        assert output == f"goshawk: {flag} {folder} {what}: name that of {firmware}'s sources, or of its build\n"
        assert not logs.exists()


def test_where_px4s_own_port_is_busy_one_clear_line_says_so(tmp_path: Path) -> None:
    binaries = stand_ins(tmp_path / "bin", air=flying_air("--not-ready"))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        with contextlib.suppress(OSError):  # if it is taken already, so much the better
            taken.bind(("127.0.0.1", 14540))
        process = demo(tmp_path, binaries, "--headless", "--px4", str(tmp_path))
        output, _ = process.communicate(timeout=30)
    assert process.returncode == 1
    assert output == "goshawk: udp 14540 is busy, where PX4 speaks to the vehicle: end what has it, and try again\n"


def test_outside_a_checkout_the_packages_programs_and_files_are_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bin_dir = stand_ins(tmp_path / "bin", air=SLEEPER)
    monkeypatch.setenv("PATH", f"{bin_dir}:{os.environ['PATH']}")
    monkeypatch.chdir(ROOT)
    assert places.programs() == Path("target/release")
    assert places.vehicle_file("sim.toml") == Path("air/vehicles/sim.toml")
    monkeypatch.chdir(tmp_path)
    assert places.programs() == bin_dir
    assert places.vehicle_file("sim.toml") == places.PACKAGED / "sim.toml"
    monkeypatch.setattr(places, "PACKAGED", tmp_path / "share" / "vehicles")
    policy = tmp_path / "share" / "models" / "track.onnx"  # where the package puts it
    policy.parent.mkdir(parents=True)
    policy.touch()
    assert places.policies() == [policy]
