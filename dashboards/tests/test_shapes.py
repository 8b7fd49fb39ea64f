"""Transforms and trails of the 3-D view."""

from __future__ import annotations

import numpy as np
import viser.transforms as tf
from goshawk_dashboards.scene import shapes
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp


def test_the_drawn_camera_looks_along_body_x_with_its_top_up() -> None:
    flu_from_cv = tf.SO3(np.array(shapes.CV_FROM_FLU_WXYZ)).as_matrix()
    np.testing.assert_allclose(flu_from_cv @ [0, 0, 1], [1, 0, 0], atol=1e-12)  # optical axis: forward
    np.testing.assert_allclose(flu_from_cv @ [0, 1, 0], [0, 0, -1], atol=1e-12)  # image down: down
    np.testing.assert_allclose(flu_from_cv @ [1, 0, 0], [0, -1, 0], atol=1e-12)  # image right: right


@given(hnp.arrays(np.float64, (5, 3), elements=st.floats(-10, 10)))
def test_trunks_lean_where_their_tops_are(direction: np.ndarray) -> None:
    length = np.linalg.norm(direction, axis=1)
    for wxyz, wanted, size in zip(shapes.wxyz_from_up_K4(direction), direction, length, strict=True):
        turned = tf.SO3(wxyz).as_matrix() @ [0, 0, 1]
        np.testing.assert_allclose(turned, wanted / size if size > 1e-9 else [0, 0, 1], atol=1e-6)


def test_a_box_turns_about_the_vertical_from_east_to_north() -> None:
    yaw = np.array([0.0, 0.5, -2.0, 3.1])
    for wxyz, angle in zip(shapes.wxyz_from_yaw_B4(yaw), yaw, strict=True):
        turned = tf.SO3(wxyz).as_matrix() @ [1, 0, 0]
        np.testing.assert_allclose(turned, [np.cos(angle), np.sin(angle), 0], atol=1e-12)


def test_the_ellipsoid_is_two_sigmas_along_the_covariances_own_axes() -> None:
    turn = tf.SO3.from_z_radians(0.4).as_matrix()
    semi, wxyz = shapes.ellipsoid(turn @ np.diag([0.04, 0.25, 0.01]) @ turn.T)
    np.testing.assert_allclose(sorted(semi), [0.2, 0.4, 1.0], atol=1e-9)
    axes = tf.SO3(wxyz).as_matrix()
    longest = axes[:, int(np.argmax(semi))]
    assert abs(longest @ turn[:, 1]) > 1 - 1e-9
    assert np.linalg.det(axes) > 0


def test_a_broken_covariance_still_gives_something_drawable() -> None:
    semi, _ = shapes.ellipsoid(np.diag([-1.0, 0.0, 1e9]))
    assert semi.min() >= 0.03
    assert semi.max() <= 5.0


def test_a_trail_never_grows_beyond_its_capacity() -> None:
    trail = shapes.Trail(capacity=50, spacing_m=0.1)
    for k in range(5000):
        trail.add(np.array([0.2 * k, 0.0, 0.0]))
    assert len(trail) == 50
    points = trail.points_S3()
    assert points.shape == (50, 3)
    np.testing.assert_allclose(points[[0, -1], 0], [0.2 * 4999, 0.2 * 4950])


def test_a_trail_ignores_small_steps_and_starts_anew_after_a_jump() -> None:
    trail = shapes.Trail(capacity=50, spacing_m=0.1, jump_m=5.0)
    assert trail.add(np.zeros(3))
    assert not trail.add(np.array([0.05, 0.0, 0.0]))
    assert trail.add(np.array([0.2, 0.0, 0.0]))
    assert trail.add(np.array([50.0, 0.0, 0.0]))
    assert len(trail) == 1


def test_the_vehicle_is_drawn_at_the_size_asked_for() -> None:
    mesh = shapes.quadrotor(2.0, (1, 2, 3))
    motor_to_motor = 2.0 * 0.155
    assert motor_to_motor < np.linalg.norm(mesh.extents[:2]) < motor_to_motor + 2 * 2 * 0.04 * np.sqrt(2)


def test_a_person_stands_on_its_ground_point() -> None:
    z = np.asarray(shapes.person().vertices)[:, 2]
    np.testing.assert_allclose([z.min(), z.max()], [-0.95, 0.80], atol=0.02)
