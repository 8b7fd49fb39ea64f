"""A recording plays through `goshawk-camera` into a flight: real camera driver, real vehicle, simulated autopilot."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from camera_process import COMMAND
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_proto import goshawk_pb2 as pb
from lenses import rig as rig_of
from rig import BIN, ROOT, VEHICLE, Rig, free_port
from software_camera import Shot, SoftwareCamera

BEGIN_S, LONG_S, RATE_HZ = 6.0, 5.0, 30
"""Of the simulated chase: from when the target is well in view."""


def shots(flight: Flight) -> Iterator[Shot]:
    begun_ms = time.time() * 1000.0
    times_s = [t for t in flight.times_s("rgbd") if 0.0 <= t - flight.times_s("rgbd")[0] - BEGIN_S < LONG_S]
    for k, time_s in enumerate(times_s):
        frame = flight.frame_at(time_s)
        assert frame is not None
        rgb_HW3, depth_m_HW = frame.rgb_HW3(), frame.depth_m_HW()
        assert rgb_HW3 is not None and depth_m_HW is not None
        depth_mm_HW = np.rint(1000.0 * depth_m_HW).astype(np.uint16)
        yield Shot(colour_HW3=rgb_HW3, depth_HW=depth_mm_HW, wall_ms=begun_ms + k * 1000.0 / RATE_HZ)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a camera would have recorded of a simulated chase, written by librealsense."""
    folder = tmp_path_factory.mktemp("chase")
    command = [BIN / "goshawk-sim", "fly", "--task", "track", "--speed", "3", "--trials", "1", "--log", folder]
    subprocess.run([str(c) for c in command], cwd=ROOT, check=True, capture_output=True, timeout=240)
    (log,) = folder.rglob("*.mcap")
    return SoftwareCamera(rig_of((160, 96))).record(folder / "chase.db3", shots(Flight.open(log)))


def test_a_recording_through_goshawk_camera_makes_the_vehicle_ready_and_it_flies_after_what_it_sees(
    rig: Rig, recording: Path
) -> None:
    rig.air()
    nobody = f"tcp/127.0.0.1:{free_port()}"  # the simulator's own images reach no vehicle
    rig.spawn(
        "sim", BIN / "goshawk-sim", "serve", "--connect", nobody, "--mavlink-port", str(rig.mavlink_port), "--seed", "3"
    )
    with rig.link() as link:
        lacking = link.wait_for(
            lambda s: reasons(s) >= {"camera"} and reasons(s).isdisjoint({"autopilot", "odometry"}), 30.0
        )
        assert lacking is not None, (link.snapshot().health, rig.output("air"))
        rig.spawn(
            "camera", *COMMAND, "run", "--config", VEHICLE, "--play", recording, "--loop", "--connect", rig.endpoint
        )
        ready = link.wait_for(lambda s: s.health is not None and s.health.ready, 30.0)
        assert ready is not None, (reasons(link.snapshot()), rig.output("camera"), rig.output("air"))
        assert link.start().accepted
        chased = link.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.target is not None, 40.0)
        assert chased is not None, (link.snapshot().mode, rig.output("camera"), rig.output("air"))


def reasons(snap: Snapshot) -> set[str]:
    """The names of the checks that fail."""
    return set() if snap.health is None else {check.name for check in snap.health.checks if not check.ok}
