"""What keeps the vehicle waiting for nothing: a disk that hangs, and a terminal that nobody reads, or that is gone."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from goshawk_dashboards.state.views import HealthView
from goshawk_proto import goshawk_pb2 as pb
from rig import BIN, Rig

FLYING = {pb.MODE_TRACK, pb.MODE_SEARCH, pb.MODE_HOLD}
GROUND = {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}
#: Of ptrace(2).
SEIZE, INTERRUPT, DETACH = 0x4206, 0x4207, 17
WAIT_FOR_THREAD = 0x40000000
LIBC = ctypes.CDLL(None, use_errno=True)
LIBC.ptrace.argtypes = [ctypes.c_long] * 4
LIBC.ptrace.restype = ctypes.c_long


def thread(process: subprocess.Popen[bytes], name: str) -> int:
    tasks = Path(f"/proc/{process.pid}/task").iterdir()
    return next(int(task.name) for task in tasks if (task / "comm").read_text().strip() == name)


@contextmanager
def standing(tid: int) -> Generator[None]:
    """The thread stands still, as one does that the disk does not answer."""
    if LIBC.ptrace(SEIZE, tid, 0, 0) != 0:
        pytest.skip(f"no thread can be stopped here: {os.strerror(ctypes.get_errno())}")
    assert LIBC.ptrace(INTERRUPT, tid, 0, 0) == 0
    os.waitpid(tid, WAIT_FOR_THREAD)
    try:
        yield
    finally:
        LIBC.ptrace(DETACH, tid, 0, 0)


def takes_off(rig: Rig, *mishaps: str) -> None:
    rig.sim("--seed", "5", "--spacing", "6", "--speed", "2", *mishaps)
    with rig.link() as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 40.0), rig.output("air")
        assert link.start().accepted
        assert link.wait_for(lambda s: s.mode in FLYING, 30.0), rig.output("air")


def hangs(health: HealthView) -> bool:
    return any(check.name == "recorder" and "the disk hangs" in check.reason for check in health.checks)


def test_a_disk_that_hangs_after_the_landing_silences_nobody_and_forbids_the_next_start(rig: Rig) -> None:
    air = rig.air()
    takes_off(rig)
    with rig.link() as link, standing(thread(air, "recorder")):
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in GROUND, 40.0), rig.output("air")

        told = link.wait_for(lambda s: s.health is not None and hangs(s.health), 10.0)
        assert told is not None and told.health is not None, rig.output("air")
        seq = told.health.seq
        assert link.wait_for(lambda s: s.health is not None and s.health.seq > seq + 4, 10.0), "it fell silent"
        refused = link.start()
        assert not refused.accepted and "ready" in refused.text, refused
    with rig.link() as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 20.0), rig.output("air")
    (log,) = rig.logs.glob("*.mcap")
    assert f"log finished: {log}" in rig.output("air")


def test_who_stops_reading_its_messages_holds_up_nothing(rig: Rig) -> None:
    read, write = os.pipe()
    rig.processes["air"] = subprocess.Popen(rig.air_command(), stderr=write, start_new_session=True)
    begun = b""
    while b"listening on" not in begun:
        begun += os.read(read, 4096)
    os.set_blocking(write, False)
    with pytest.raises(BlockingIOError):
        while True:
            os.write(write, b".")
    os.set_blocking(write, True)
    rig.sim("--seed", "5", "--spacing", "6", "--speed", "2")
    with rig.link() as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 40.0), rig.output("sim")
    air = rig.processes["air"]
    air.terminate()
    assert air.wait(timeout=15) == 0
    os.close(read)
    os.close(write)


@pytest.fixture
def terminal() -> Generator[None]:
    """The processes hear that a terminal closes, even under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("terminal")
def test_a_terminal_that_goes_in_flight_takes_nothing_down_and_on_the_ground_the_process(rig: Rig) -> None:
    air = rig.air()
    takes_off(rig)
    air.send_signal(signal.SIGHUP)
    time.sleep(1.0)
    with rig.link() as link:
        assert link.wait_for(lambda s: s.mode in FLYING, 5.0), rig.output("air")
        assert link.stop().accepted
        # Down, and gone at once: it may not say any more that it is down.
        assert air.wait(timeout=60) == 0
    (log,) = rig.logs.glob("*.mcap")
    assert f"log finished: {log}" in rig.output("air")


@pytest.mark.usefixtures("terminal")
def test_a_terminal_that_goes_takes_nothing_down_while_the_pilot_flies(rig: Rig) -> None:
    """He took it over: it is in the air, its log goes on, and so does what it tells."""
    air = rig.air()
    takes_off(rig, "--mishap", "sticks=1.5@3")
    with rig.link() as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_FAULT, 20.0), rig.output("air")
        air.send_signal(signal.SIGHUP)
        time.sleep(2.0)
        assert air.poll() is None and link.snapshot().mode == pb.MODE_FAULT, rig.output("air")


def test_who_stops_reading_what_the_simulator_prints_does_not_end_its_world(rig: Rig, tmp_path: Path) -> None:
    reader, writer = os.pipe()
    command = [BIN / "goshawk-sim", "serve", "--connect", rig.endpoint, "--mavlink-port", str(rig.mavlink_port)]
    with (tmp_path / "errors").open("wb") as errors:
        world = subprocess.Popen([str(part) for part in command], stdout=writer, stderr=errors)
    os.close(writer)
    os.close(reader)
    time.sleep(3.0)
    assert world.poll() is None, (tmp_path / "errors").read_text()
    world.send_signal(signal.SIGINT)
    assert world.wait(timeout=20) == 0, (tmp_path / "errors").read_text()
