"""A camera and a ground that come and go cost the vehicle nothing that stays."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from restarts import MOST_DESCRIPTORS, MOST_MB, growth, restarts
from rig import Rig

ABANDON = """
import os, zenoh
from zenoh.shm import ShmProvider
provider = ShmProvider.default_backend(1 << 20)
buffer = provider.alloc(1 << 16)
print("made", flush=True)
os.kill(os.getpid(), 9)
"""


def test_thirty_restarts_of_camera_and_ground_leave_nothing_behind(rig: Rig) -> None:
    memory_mb, descriptors, shared_mb = growth(*restarts(30, rig))
    assert memory_mb < MOST_MB
    assert descriptors < MOST_DESCRIPTORS
    assert shared_mb < MOST_MB


def test_what_a_killed_process_left_in_shared_memory_goes_when_the_vehicle_starts(rig: Rig) -> None:
    before = set(Path("/dev/shm").glob("*.zenoh"))
    killed = subprocess.run([sys.executable, "-c", ABANDON], capture_output=True, text=True, timeout=20, check=False)
    left = set(Path("/dev/shm").glob("*.zenoh")) - before
    assert killed.stdout == "made\n" and left, killed.stderr
    rig.air()
    with rig.link() as ground:
        assert ground.wait_for(lambda s: s.health is not None, 20.0), rig.output("air")
    assert not [file for file in left if file.exists()]
