"""A second flight from where the first one ended."""

from __future__ import annotations

from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_proto import goshawk_pb2 as pb
from rig import Rig


def stands_near(snap: Snapshot) -> bool:
    """The vehicle is ready, and the target stands near it with its whole run before it."""
    ready = snap.mode == pb.MODE_READY and snap.health is not None and snap.health.ready
    truth = snap.truth
    return ready and truth is not None and truth.target_path_m == 0.0 and truth.target_distance_m < 8.0


def chased(snap: Snapshot) -> bool:
    """It has run for a while, and the vehicle is after it."""
    return snap.mode == pb.MODE_TRACK and snap.truth is not None and snap.truth.target_path_m > 3.0


def test_after_a_landing_the_target_stands_near_the_vehicle_and_start_chases_it_again(rig: Rig) -> None:
    rig.air()
    rig.sim("--seed", "1", "--distance", "40")
    with rig.link() as link:
        for _ in range(2):
            assert link.wait_for(stands_near, 60.0) is not None, rig.output("air") + rig.output("sim")
            assert link.start().accepted
            assert link.wait_for(chased, 40.0) is not None, rig.output("air") + rig.output("sim")
            assert link.stop().accepted
