"""What happens to a flight's log when the disk is full, and when the vehicle's process is killed."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import struct
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recover import recover
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_proto import goshawk_pb2
from goshawk_proto import goshawk_pb2 as pb
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader
from rig import BIN, Rig

FLYING = {pb.MODE_TRACK, pb.MODE_SEARCH, pb.MODE_HOLD}
#: What the file system lets the vehicle write into one file.
DISK_BYTES = 12_000_000
#: A file system of its own for the logs: its size, and what is left of it beside a file that is no log.
SMALL_BYTES, SMALL_FREE_BYTES = 64 << 20, 14 << 20


def fly(rig: Rig, *, disk_bytes: int | None = None) -> None:
    """Starts a flight and waits until it is in the air."""

    def small_disk() -> None:
        if disk_bytes is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # the write fails instead, as on a full disk
            resource.setrlimit(resource.RLIMIT_FSIZE, (disk_bytes, resource.RLIM_INFINITY))

    with (rig.folder / "air.out").open("wb") as out:
        rig.processes["air"] = subprocess.Popen(
            rig.air_command(), stdout=out, stderr=out, start_new_session=True, preexec_fn=small_disk
        )
    rig.sim("--seed", "5", "--spacing", "6", "--speed", "2")
    with rig.link() as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 40.0), rig.output("air")
        assert link.start().accepted
        assert link.wait_for(lambda s: s.mode in FLYING, 30.0), rig.output("air")


def controls(log: Path) -> list[int]:
    """Stamps of the controller's steps, ns, as far as the stock reader gets."""
    stamps: list[int] = []
    with log.open("rb") as stream:
        try:
            for _, _, message in NonSeekingReader(stream).iter_messages(topics=["tel/control"], log_time_order=False):
                stamps.append(goshawk_pb2.Control.FromString(message.data).stamp_ns)
        except (McapError, EOFError, ValueError, struct.error):
            pass  # where the file was cut off
    return stamps


def replays(log: Path) -> str:
    done = subprocess.run([str(BIN / "goshawk-air"), "replay", str(log)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_killed_vehicle_loses_at_most_a_second_of_its_log(rig: Rig) -> None:
    fly(rig)
    time.sleep(3.0)
    os.killpg(rig.processes["air"].pid, signal.SIGKILL)
    killed_ns = time.clock_gettime_ns(time.CLOCK_MONOTONIC)
    rig.processes["air"].wait()
    (log,) = rig.logs.glob("*.mcap")
    stamps = controls(log)
    assert len(stamps) > 500
    assert killed_ns - stamps[-1] < 1_000_000_000
    assert "no difference" in replays(log)


def test_a_full_disk_ends_the_recording_and_not_the_flight(rig: Rig) -> None:
    fly(rig, disk_bytes=DISK_BYTES)
    with rig.link() as link:
        told = link.wait_for(
            lambda s: s.health is not None and any("recorder" in fault for fault in s.health.faults), 40.0
        )
        assert told is not None and told.health is not None, rig.output("air")
        assert told.mode in FLYING | {pb.MODE_TAKEOFF}
        later = link.wait_for(lambda s: s.plan is not None and told.plan is not None
                              and s.plan.seq > told.plan.seq + 30 and s.mode in FLYING, 10.0)  # fmt: skip
        assert later is not None, "it flies on"
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}, 40.0), rig.output("air")
    (log,) = rig.logs.glob("*.mcap")
    assert DISK_BYTES - 2_000_000 < log.stat().st_size <= DISK_BYTES
    assert len(controls(log)) > 200
    assert "no difference" in replays(log)


def test_once_a_full_disk_is_freed_the_next_flight_starts_and_is_recorded(rig: Rig) -> None:
    fly(rig, disk_bytes=DISK_BYTES)
    pid = rig.processes["air"].pid

    def told(s: Snapshot, ready: bool) -> bool:
        faults = () if s.health is None else s.health.faults
        recorder = any("recorder" in fault for fault in faults)
        return s.health is not None and recorder != ready and s.health.ready == ready

    with rig.link() as link:
        assert link.wait_for(lambda s: told(s, False), 40.0), rig.output("air")
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (1_000_000, resource.RLIM_INFINITY))  # full to the last block
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}, 40.0), rig.output("air")
        time.sleep(4.0)  # the disk was tried again, and is full
        refused = link.start()
        assert not refused.accepted and "ready" in refused.text, refused
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))  # freed
        assert link.wait_for(lambda s: told(s, True), 20.0), rig.output("air")
        assert link.start().accepted
        assert link.wait_for(lambda s: s.mode in FLYING, 30.0), rig.output("air")
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}, 40.0), rig.output("air")
    rig.close()
    _, second = sorted(rig.logs.glob("*.mcap"))
    assert "no difference" in replays(second)


@pytest.fixture
def ballast(rig: Rig) -> Iterator[Path]:
    """Logs go to a small file system; the file that fills most of it."""
    if os.geteuid() != 0:
        pytest.skip("only root may mount a file system")
    rig.logs.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={SMALL_BYTES}", "goshawk-test", str(rig.logs)]
    done = subprocess.run(mount, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip(f"no file system can be mounted here: {done.stderr.strip()}")
    ballast = rig.logs / "film.bin"
    try:
        ballast.write_bytes(bytes(SMALL_BYTES - SMALL_FREE_BYTES))
        yield ballast
    finally:
        rig.close()
        subprocess.run(["umount", str(rig.logs)], check=True)


def test_on_a_file_system_that_is_full_it_flies_on_and_records_again_once_there_is_space(
    rig: Rig, ballast: Path
) -> None:
    def recorder_failed(s: Snapshot) -> bool:
        return s.health is not None and any("recorder" in fault for fault in s.health.faults)

    fly(rig)
    (first,) = rig.logs.glob("*.mcap")
    with rig.link() as link:
        told = link.wait_for(recorder_failed, 40.0)
        assert told is not None and told.plan is not None, rig.output("air")
        assert "No space left on device" in rig.output("air")
        assert shutil.disk_usage(rig.logs).free < 1 << 20
        seq = told.plan.seq
        assert link.wait_for(lambda s: s.plan is not None and s.plan.seq > seq + 60 and s.mode in FLYING, 10.0)
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}, 40.0), rig.output("air")
        time.sleep(4.0)  # the disk was tried again, and is full
        refused = link.start()
        assert not refused.accepted and "ready" in refused.text, refused
        ballast.unlink()
        assert link.wait_for(lambda s: s.health is not None and s.health.ready and not recorder_failed(s), 20.0)
        assert link.start().accepted
        assert link.wait_for(lambda s: s.mode in FLYING, 30.0), rig.output("air")
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}, 40.0), rig.output("air")
        assert not recorder_failed(link.snapshot())
    rig.close()
    _, second = sorted(rig.logs.glob("*.mcap"))
    for log in [first, second]:
        assert len(controls(log)) > 200
        assert "no difference" in replays(log)
    assert Flight.open(second).completeness == "complete"


def test_a_log_with_a_hole_is_replayed_around_it_and_called_damaged(rig: Rig) -> None:
    fly(rig)
    time.sleep(6.0)
    rig.close()
    (log,) = rig.logs.glob("*.mcap")
    data = bytearray(log.read_bytes())
    middle = len(data) // 2
    data[middle : middle + 4096] = bytes(4096)
    log.write_bytes(data)
    replay = [str(BIN / "goshawk-air"), "replay", str(log)]
    done = subprocess.run(replay, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1
    assert "the log is damaged, not cut off; left out: " in done.stdout, done.stdout + done.stderr
    clean = rig.folder / "clean.mcap"
    assert recover(log, clean).missing
    assert Flight.open(clean).completeness == "complete"
