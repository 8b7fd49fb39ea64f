"""What restarts of the camera's process and of the ground cost the vehicle's process: memory, descriptors, /dev/shm.

    .venv/bin/python tests/e2e/restarts.py 1000

Each round starts a camera in a process of its own, which publishes ten images at 30 Hz with Zenoh's own settings and is
killed with SIGKILL, and a ground that connects, waits for a heartbeat and goes. Prints a table; the growth is counted
from the tenth round on, after which nothing is loaded for the first time. Exit status 1: a bound is exceeded.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import zenoh
from goshawk_proto import goshawk_pb2 as pb
from goshawk_proto import key_expression

sys.path.insert(0, str(Path(__file__).parent))

from rig import Rig

MOST_MB = 5.0
MOST_DESCRIPTORS = 5
FIRST = 10
WIDTH, HEIGHT = 160, 96


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What the vehicle's process holds."""

    memory_mb: float
    """Its own and what it shares, mapped segments included."""
    descriptors: int
    shared_mb: float
    """Of Zenoh's segments in /dev/shm, whoever left them."""

    @classmethod
    def of(cls, pid: int) -> Cost:
        """Reads /proc and /dev/shm."""
        fields = dict(line.split(":", 1) for line in Path(f"/proc/{pid}/status").read_text().splitlines())
        segments = sum(file.stat().st_size for file in Path("/dev/shm").glob("*.zenoh"))
        return cls(
            memory_mb=int(fields["VmRSS"].split()[0]) / 1024,
            descriptors=sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir()),
            shared_mb=segments / 1e6,
        )


def camera(endpoint: str) -> None:
    """Publishes images until it is killed."""
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    publisher = session.declare_publisher(key_expression("rgbd", "goshawk"))
    pixels = WIDTH * HEIGHT
    for seq in range(1_000_000):
        frame = pb.Rgbd(
            seq=seq, stamp_ns=time.clock_gettime_ns(time.CLOCK_MONOTONIC), width=WIDTH, height=HEIGHT, hfov_rad=1.5708,
            vfov_rad=1.0809, rgb=os.urandom(3 * pixels), depth_mm=os.urandom(2 * pixels),
        )  # fmt: skip
        publisher.put(frame.SerializeToString())
        if seq == 10:
            print("seen", flush=True)
        time.sleep(1 / 30)


def one_round(rig: Rig) -> None:
    """A camera and a ground come and go."""
    command = [sys.executable, __file__, "--camera", rig.endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, start_new_session=True) as process:
        with rig.link() as ground:
            assert ground.wait_for(lambda s: s.health is not None, 20.0), rig.output("air")
        assert process.stdout is not None
        assert process.stdout.readline() == b"seen\n"
        process.kill()


def restarts(rounds: int, rig: Rig) -> tuple[Cost, Cost]:
    """What the vehicle held after the first rounds and after the last one."""
    air = rig.air()
    print(f"{'restarts':>9}{'memory MB':>11}{'descriptors':>13}{'/dev/shm MB':>13}", flush=True)
    first = None
    for done in range(1, rounds + 1):
        one_round(rig)
        if done == FIRST or done % max(1, rounds // 10) == 0:
            if done == FIRST:
                time.sleep(3.0)  # the leases of those that went
            cost = Cost.of(air.pid)
            first = first or (cost if done >= FIRST else None)
            print(f"{done:>9}{cost.memory_mb:>11.1f}{cost.descriptors:>13}{cost.shared_mb:>13.1f}", flush=True)
    time.sleep(3.0)
    last = Cost.of(air.pid)
    assert first is not None, f"at least {FIRST} rounds"
    return first, last


def growth(first: Cost, last: Cost) -> tuple[float, int, float]:
    """Megabytes of memory, descriptors, megabytes in /dev/shm."""
    return (
        last.memory_mb - first.memory_mb,
        last.descriptors - first.descriptors,
        last.shared_mb - first.shared_mb,
    )


def main() -> int:
    """The command line."""
    if sys.argv[1] == "--camera":
        camera(sys.argv[2])
        return 0
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(folder=Path(folder))
        try:
            first, last = restarts(int(sys.argv[1]), rig)
        finally:
            rig.close()
    memory_mb, descriptors, shared_mb = growth(first, last)
    print(f"growth: {memory_mb:+.1f} MB, {descriptors:+d} descriptors, {shared_mb:+.1f} MB in /dev/shm")
    return 0 if memory_mb < MOST_MB and descriptors < MOST_DESCRIPTORS and shared_mb < MOST_MB else 1


if __name__ == "__main__":
    sys.exit(main())
