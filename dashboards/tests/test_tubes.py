"""Curves are drawn as tubes: the corners stand about the curve, however it runs."""

from __future__ import annotations

import numpy as np
import pytest
from goshawk_dashboards.scene.tubes import SIDES, tube_faces, tube_S33


@pytest.mark.parametrize(
    "along_3", [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 1.0)]
)
def test_a_tube_is_as_thick_as_asked_for_whichever_way_it_runs(along_3: tuple[float, float, float]) -> None:
    points_S3 = np.linspace(0.0, 2.0, 5)[:, None] * np.array(along_3)
    corner_S33 = tube_S33(points_S3, np.linspace(0.2, 0.0, 5))
    from_way_S33 = corner_S33 - points_S3[:, None]
    thick_S3 = np.linalg.norm(from_way_S33, axis=2)
    np.testing.assert_allclose(thick_S3, np.repeat(np.linspace(0.2, 0.0, 5)[:, None], SIDES, axis=1), atol=1e-12)
    np.testing.assert_allclose(from_way_S33 @ np.array(along_3), 0.0, atol=1e-12)


def test_points_that_repeat_make_no_corner_that_is_not_finite() -> None:
    assert np.isfinite(tube_S33(np.ones((4, 3)), np.full(4, 0.1))).all()


def test_every_corner_of_a_tube_is_in_a_face_and_no_face_has_others() -> None:
    faces = tube_faces(4)
    assert faces.shape == (3 * SIDES * 2, 3)
    assert set(faces.ravel()) == set(range(4 * SIDES))
