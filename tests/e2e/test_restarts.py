"""A camera and a ground that come and go cost the vehicle nothing that stays."""

from __future__ import annotations

from restarts import MOST_DESCRIPTORS, MOST_MB, growth, restarts
from rig import Rig


def test_thirty_restarts_of_camera_and_ground_leave_nothing_behind(rig: Rig) -> None:
    memory_mb, descriptors, shared_mb = growth(*restarts(30, rig))
    assert memory_mb < MOST_MB
    assert descriptors < MOST_DESCRIPTORS
    assert shared_mb < MOST_MB
