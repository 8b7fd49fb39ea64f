"""A viewer's camera follows the vehicle from wherever the viewer has turned it to."""

from __future__ import annotations

import numpy as np
from goshawk_dashboards.scene.cameras import START_OFFSET_FLU_3, Viewpoint, turned, yaw_of

PLACED = np.array([-5.0, 2.0, 2.4])


def test_reports_from_before_the_placement_do_not_move_the_camera() -> None:
    view = Viewpoint(PLACED)
    view.reported(np.array([3.0, 3.0, 3.0]))
    np.testing.assert_array_equal(view.offset_3, PLACED)
    assert not view.settled


def test_the_viewers_turns_count_once_the_placement_was_seen() -> None:
    view = Viewpoint(PLACED)
    view.reported(PLACED + 0.01)
    assert view.settled
    view.reported(np.array([0.0, 8.0, 1.0]))
    np.testing.assert_array_equal(view.offset_3, [0.0, 8.0, 1.0])


def test_a_camera_inside_the_vehicle_or_nowhere_is_ignored() -> None:
    view = Viewpoint(PLACED)
    view.settled = True
    view.reported(np.zeros(3))
    view.reported(np.array([np.nan, 0.0, 0.0]))
    np.testing.assert_array_equal(view.offset_3, PLACED)


def test_the_chase_camera_ends_behind_at_the_viewers_distance_and_height() -> None:
    for yaw in (0.0, 1.0, np.pi, -2.5):
        view = Viewpoint(PLACED)
        for _ in range(200):
            view.turn_behind(yaw)
        reach = np.hypot(*PLACED[:2])
        np.testing.assert_allclose(view.offset_3, [-reach * np.cos(yaw), -reach * np.sin(yaw), 2.4], atol=1e-6)


def test_the_first_camera_stands_behind_and_left_of_any_heading() -> None:
    north = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])
    x, y, z = turned(START_OFFSET_FLU_3, yaw_of(north))
    assert y < -4.0  # behind is south
    assert x < -1.0  # left is west
    assert z > 1.0
