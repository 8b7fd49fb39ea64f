"""Lenses: from a point before the camera to a pixel. The frame is its makers': x right, y down, z forward.

Shape suffixes: N points, 2 a pixel (u right, v down; whole numbers are centres), 3 a point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Distortion = Literal["none", "brown_conrady", "modified_brown_conrady"]


@dataclass(frozen=True, kw_only=True)
class Lens:
    """An image's intrinsics, in pixels."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Distortion = "none"
    coefficients: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3."""

    @property
    def distorted(self) -> bool:
        return self.distortion != "none" and any(self.coefficients)

    @property
    def half_x(self) -> float:
        """The tangent of half the field that is seen on both sides of the axis, from left to right."""
        return min(self.cx + 0.5, self.width - 0.5 - self.cx) / self.fx

    @property
    def half_y(self) -> float:
        """Likewise from top to bottom."""
        return min(self.cy + 0.5, self.height - 0.5 - self.cy) / self.fy

    @property
    def fov_deg(self) -> tuple[float, float]:
        """What it sees to both sides of its axis: horizontal, vertical."""
        return 2.0 * math.degrees(math.atan(self.half_x)), 2.0 * math.degrees(math.atan(self.half_y))

    def project(self, points_N3: Floats) -> Floats:
        """The pixels of points; they lie in front of the lens. Equations: librealsense's two Brown-Conrady models."""
        x, y = points_N3[:, 0] / points_N3[:, 2], points_N3[:, 1] / points_N3[:, 2]
        if self.distorted:
            k1, k2, p1, p2, k3 = self.coefficients
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            a, b = (x * radial, y * radial) if self.distortion == "modified_brown_conrady" else (x, y)
            x, y = (
                x * radial + 2.0 * p1 * a * b + p2 * (r2 + 2.0 * a * a),
                y * radial + 2.0 * p2 * a * b + p1 * (r2 + 2.0 * b * b),
            )
        return np.stack([x * self.fx + self.cx, y * self.fy + self.cy], axis=1)

    def rays(self, u_N: Floats, v_N: Floats) -> Floats:
        """The points at z = 1 of pixels of a lens without distortion."""
        return np.stack([(u_N - self.cx) / self.fx, (v_N - self.cy) / self.fy, np.ones_like(u_N)], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rig:
    """A camera's two lenses and how they stand to each other."""

    colour: Lens
    depth: Lens
    rotation_33: Floats
    """colour_from_depth."""
    translation_3: Floats
    """Of the depth lens in the colour's frame, m."""
    depth_unit_mm: float = 1.0
    """What one step of the depth image stands for."""
