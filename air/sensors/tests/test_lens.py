"""Our lens against librealsense's own."""

from __future__ import annotations

import numpy as np
import pytest
from goshawk_sensors.cameras.librealsense import rs
from goshawk_sensors.view.pinhole import Distortion, Lens
from hypothesis import given
from hypothesis import strategies as st


@given(
    model=st.sampled_from(["brown_conrady", "modified_brown_conrady", "inverse_brown_conrady"]),
    coefficients=st.tuples(*[st.floats(-0.08, 0.08)] * 5),
    x=st.floats(-1.0, 1.0),
    y=st.floats(-0.7, 0.7),
    z=st.floats(0.3, 20.0),
)
def test_a_point_falls_on_the_pixel_that_librealsense_says(
    model: str, coefficients: tuple[float, float, float, float, float], x: float, y: float, z: float
) -> None:
    theirs = rs.intrinsics()
    theirs.width, theirs.height, theirs.fx, theirs.fy, theirs.ppx, theirs.ppy = 848, 480, 425.0, 424.0, 420.0, 241.0
    theirs.model, theirs.coeffs = getattr(rs.distortion, model), list(coefficients)
    kind: Distortion = "brown_conrady" if model == "brown_conrady" else "modified_brown_conrady"
    ours = Lens(
        width=848, height=480, fx=425.0, fy=424.0, cx=420.0, cy=241.0, distortion=kind, coefficients=coefficients
    )
    point = np.array([[x * z, y * z, z]], dtype=np.float32)
    expected = rs.rs2_project_point_to_pixel(theirs, point[0].tolist())
    assert ours.project(point)[0] == pytest.approx(expected, abs=0.01)
