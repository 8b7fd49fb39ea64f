"""Each example does what it says, with the real onboard process where one is needed."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.state.snapshot import Snapshot
from rig import ROOT, Rig, copied

EXAMPLES = ROOT / "examples"
PROGRAMS = sorted(EXAMPLES.glob("*.py"))


def run(name: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, EXAMPLES / name, *arguments]
    return subprocess.run([str(c) for c in command], capture_output=True, text=True, timeout=120)


def good(snap: Snapshot, name: str) -> bool:
    return snap.health is not None and any(check.name == name and check.ok for check in snap.health.checks)


def bad(snap: Snapshot, name: str) -> bool:
    return snap.health is not None and any(check.name == name and not check.ok for check in snap.health.checks)


def becomes_good(rig: Rig, name: str, example: str, *arguments: str | Path) -> None:
    """The vehicle's check fails before the example runs, and holds while it does."""
    with rig.link() as link:
        assert link.wait_for(lambda s: bad(s, name), 30.0) is not None, rig.output("air")
        rig.spawn("example", sys.executable, EXAMPLES / example, *arguments, "--connect", rig.endpoint)
        snap = link.wait_for(lambda s: good(s, name), 30.0)
        assert snap is not None, (link.snapshot().health, rig.output("example"), rig.output("air"))


def test_there_are_six_and_none_is_longer_than_80_lines() -> None:
    assert len(PROGRAMS) == 6
    assert all(len(path.read_text(encoding="utf-8").splitlines()) < 80 for path in PROGRAMS)


def test_the_vehicle_takes_the_examples_pictures_for_a_cameras(rig: Rig) -> None:
    rig.air()
    becomes_good(rig, "camera", "camera.py")


def test_the_vehicle_takes_a_logs_images_for_a_cameras(rig: Rig, log: Path) -> None:
    rig.air()
    becomes_good(rig, "camera", "replayed_camera.py", log)


def test_all_images_of_a_log_are_sent(rig: Rig, log: Path) -> None:
    rig.air()
    with rig.link() as link:
        assert link.wait_for(lambda s: s.health is not None, 30.0) is not None, rig.output("air")
        done = run("replayed_camera.py", log, "--connect", rig.endpoint)
    images = Flight.open(log).count("rgbd")
    assert images > 0
    assert done.stdout.strip() == f"{images} of {images} images sent", done.stderr


def test_the_vehicle_takes_the_examples_odometry_for_an_estimators(rig: Rig) -> None:
    text = copied()
    path = rig.folder / "vehicle.toml"
    path.write_text(text.replace('odometry = "autopilot"', 'odometry = "zenoh"'))
    rig.air(vehicle=path)
    becomes_good(rig, "odometry", "vio_odometry.py")


def test_a_watched_vehicle_says_what_it_lacks(rig: Rig) -> None:
    rig.air()
    done = run("watch_telemetry.py", "--connect", rig.endpoint, "--seconds", "6")
    assert done.returncode == 0, done.stderr + rig.output("air")
    assert re.search(r"^idle, not ready: .*camera: ", done.stdout, re.MULTILINE), done.stdout


def test_whoever_ends_a_watch_of_nobody_is_told_why_nothing_was_heard() -> None:
    command = [sys.executable, str(EXAMPLES / "watch_telemetry.py"), "--connect", "tcp/127.0.0.1:1"]
    watching = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert watching.stdout is not None
    assert watching.stdout.readline() == "nothing heard\n"
    watching.send_signal(signal.SIGINT)
    _, said = watching.communicate(timeout=60)
    assert (watching.returncode, len(said.strip().splitlines())) == (1, 1), said
    assert said.startswith("watch_telemetry.py: ")


def test_a_logs_phases_and_speed_are_printed(log: Path) -> None:
    done = run("read_log.py", log)
    assert done.returncode == 0, done.stderr
    assert f"{log.name}: {Flight.open(log).duration_s:.1f} s, complete" in done.stdout
    assert "tracking" in done.stdout
    assert re.search(r"^speed: mean \d\.\d, most \d\.\d m/s$", done.stdout, re.MULTILINE), done.stdout


def test_a_flight_by_a_program_is_started_watched_stopped_and_kept(rig: Rig) -> None:
    rig.spawn("fake", sys.executable, ROOT / "tests/browser/fake_vehicle.py", "--listen", rig.endpoint)
    log = rig.folder / "flight.mcap"
    done = run("fly.py", "--connect", rig.endpoint, "--seconds", "5", "--record", log)
    assert done.returncode == 0, done.stderr + rig.output("fake")
    first, *watched, last = done.stdout.splitlines()
    assert (first, last) == ("taking off", "braking, then landing")
    assert re.search(r"^track, \d+\.\d m/s$", "\n".join(watched), re.MULTILINE), done.stdout
    assert [phase.name for phase in Flight.open(log).phases][-1] == "landed"
    again = run("fly.py", "--connect", rig.endpoint, "--record", log)
    assert (again.returncode, again.stdout) == (1, "")
    assert "is there already" in again.stderr


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda path: path.name)
def test_a_wrong_place_is_one_line_and_a_status_of_its_own(program: Path, tmp_path: Path) -> None:
    nothing = tmp_path / "no.mcap"
    arguments: dict[str, tuple[str | Path, ...]] = {
        "read_log.py": (nothing,),
        "replayed_camera.py": (nothing,),
        "watch_telemetry.py": ("--connect", "nowhere"),
        "fly.py": ("--connect", "nowhere"),
    }
    done = run(program.name, *arguments.get(program.name, ("--connect", "tcp/127.0.0.1:1")))
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert done.stderr.startswith(program.name), done.stderr
