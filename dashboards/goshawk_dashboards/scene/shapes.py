"""Meshes and transforms that the scene draws: the vehicle, the person, trees, ellipsoids, trails."""

from __future__ import annotations

from collections import deque

import numpy as np
import trimesh
import trimesh.visual
import viser.transforms as tf

from goshawk_dashboards.page import theme
from goshawk_dashboards.state.views import Array

CV_FROM_FLU_WXYZ = (0.5, -0.5, 0.5, -0.5)
"""Rotation flu_from_cv: viser draws cameras looking along z with y down, ours look along x with z up."""

TRAIL_POINTS = 200
"""Of a drawn trail, at most: 60 m at its usual spacing."""
TRAIL_RADIUS_M = 0.03
"""At its newest point; it tapers to nothing."""

PERSON_HEIGHT_M = 1.75
PERSON_CENTRE_M = 0.95
"""Height of a person's centre above its ground point."""


def _painted(mesh: trimesh.Trimesh, rgb: theme.Rgb) -> trimesh.Trimesh:
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=np.array([*rgb, 255], dtype=np.uint8))
    return mesh


def quadrotor(scale: float, rgb: theme.Rgb) -> trimesh.Trimesh:
    """A quadrotor in its body frame (FLU): 155 mm between opposite motors, times ``scale``; its front rotors are
    the colour of what is flown."""
    parts = [_painted(trimesh.creation.box(extents=(0.095, 0.045, 0.03)), (52, 60, 72))]
    nose = trimesh.creation.box(extents=(0.018, 0.03, 0.018))
    nose.apply_translation((0.054, 0.0, 0.004))
    parts.append(_painted(nose, rgb))
    for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        at = np.array((x, y, 0.0)) * 0.0775 / np.sqrt(2.0)
        arm = trimesh.creation.box(extents=(0.0775, 0.009, 0.007))
        turned_44 = np.eye(4)
        turned_44[:3, :3] = tf.SO3.from_z_radians(float(np.arctan2(y, x))).as_matrix()
        turned_44[:3, 3] = at / 2
        arm.apply_transform(turned_44)
        parts.append(_painted(arm, (70, 80, 96)))
        rotor = trimesh.creation.cylinder(radius=0.038, height=0.003, sections=24)
        rotor.apply_translation(at + (0.0, 0.0, 0.016))
        parts.append(_painted(rotor, theme.GOOD if x > 0 else rgb))
        hub = trimesh.creation.cylinder(radius=0.009, height=0.02, sections=12)
        hub.apply_translation(at + (0.0, 0.0, 0.008))
        parts.append(_painted(hub, (30, 34, 42)))
    mesh: trimesh.Trimesh = trimesh.util.concatenate(parts)  # type: ignore[assignment]
    mesh.apply_scale(scale)
    return mesh


def person() -> trimesh.Trimesh:
    """A standing person, the origin at the centre 0.95 m above the ground point."""
    radius, shoulder_m = 0.24, PERSON_HEIGHT_M - 0.3
    body = trimesh.creation.capsule(height=shoulder_m - 2 * radius, radius=radius, count=(16, 16))
    body.apply_translation((0.0, 0.0, shoulder_m / 2))
    head = trimesh.creation.icosphere(subdivisions=2, radius=0.15)
    head.apply_translation((0.0, 0.0, PERSON_HEIGHT_M - 0.15))
    mesh: trimesh.Trimesh = trimesh.util.concatenate([body, head])  # type: ignore[assignment]
    mesh.apply_translation((0.0, 0.0, -PERSON_CENTRE_M))
    return mesh


def trunk() -> trimesh.Trimesh:
    """A unit cylinder standing on the origin: radius 1, height 1."""
    mesh = trimesh.creation.cylinder(radius=1.0, height=1.0, sections=6)
    mesh.apply_translation((0.0, 0.0, 0.5))
    return mesh


def foliage() -> trimesh.Trimesh:
    """A unit ball, coarse on purpose: it is drawn hundreds of times."""
    return trimesh.creation.icosphere(subdivisions=0, radius=1.0)


def mote() -> trimesh.Trimesh:
    """A small ball that marks a place, as coarse as can be."""
    return trimesh.creation.icosphere(subdivisions=0, radius=0.07)


def square() -> trimesh.Trimesh:
    """A unit square about the origin, seen from above."""
    corners = [(-0.5, -0.5, 0.0), (0.5, -0.5, 0.0), (0.5, 0.5, 0.0), (-0.5, 0.5, 0.0)]
    return trimesh.Trimesh(corners, [(0, 1, 2), (0, 2, 3)], process=False)


def box() -> trimesh.Trimesh:
    """A unit cube about the origin."""
    return trimesh.creation.box(extents=(1.0, 1.0, 1.0))


def wxyz_from_yaw_B4(yaw_rad_B: Array) -> Array:
    """Rotations about the vertical."""
    zero_B = np.zeros(len(yaw_rad_B))
    return np.stack([np.cos(0.5 * yaw_rad_B), zero_B, zero_B, np.sin(0.5 * yaw_rad_B)], axis=1)


def wxyz_from_up_K4(direction_K3: Array) -> Array:
    """Rotations that turn z to each direction; the identity where a direction has no length."""
    length_K1 = np.linalg.norm(direction_K3, axis=1, keepdims=True)
    unit_K3 = np.where(length_K1 > 1e-9, direction_K3 / np.maximum(length_K1, 1e-9), (0.0, 0.0, 1.0))
    x_K, y_K, z_K = unit_K3[:, 0], unit_K3[:, 1], unit_K3[:, 2]
    # Half-way quaternion between z and the direction: (1 + z . d, z x d). Near -z its first part cancels to nothing,
    # and is had from what is across instead: 1 + z = (x^2 + y^2) / (1 - z).
    across_K = x_K**2 + y_K**2
    half_K = np.where(z_K < 0.0, across_K / (1.0 - np.minimum(z_K, 0.0)), 1.0 + z_K)
    wxyz_K4 = np.stack([half_K, -y_K, x_K, np.zeros(len(unit_K3))], axis=1)
    wxyz_K4[(z_K < 0.0) & (across_K == 0.0)] = (0.0, 1.0, 0.0, 0.0)
    return wxyz_K4 / np.linalg.norm(wxyz_K4, axis=1, keepdims=True)


def ellipsoid(covariance_33: Array, sigmas: float = 2.0) -> tuple[Array, Array]:
    """Semi-axes and rotation (wxyz) of a covariance's ellipsoid; semi-axes within 0.03 .. 5 m, to be drawable."""
    values_3, vectors_33 = np.linalg.eigh((covariance_33 + covariance_33.T) / 2.0)
    if np.linalg.det(vectors_33) < 0.0:
        vectors_33[:, 0] *= -1.0
    semi_3 = np.clip(sigmas * np.sqrt(np.maximum(values_3, 0.0)), 0.03, 5.0)
    return semi_3, tf.SO3.from_matrix(vectors_33).wxyz.astype(np.float64)


class Trail:
    """Where something has been: at most ``capacity`` points, none nearer than ``spacing_m`` to the one before."""

    def __init__(self, capacity: int = TRAIL_POINTS, spacing_m: float = 0.15, jump_m: float = 5.0) -> None:
        self._points: deque[Array] = deque(maxlen=capacity)
        self._spacing_m = spacing_m
        self._jump_m = jump_m

    def __len__(self) -> int:
        return len(self._points)

    def add(self, pos_3: Array) -> bool:
        """Takes a position if it is far enough from the last; whether it did. A jump starts the trail anew."""
        if self._points:
            step_m = float(np.linalg.norm(pos_3 - self._points[-1]))
            if step_m < self._spacing_m:
                return False
            if step_m > self._jump_m:
                self._points.clear()
        self._points.append(np.asarray(pos_3, dtype=np.float64))
        return True

    def retrace(self, points_N3: Array) -> None:
        """As if it had followed these from nothing, oldest first."""
        self.clear()
        for pos_3 in points_N3:
            self.add(pos_3)

    def clear(self) -> None:
        """Forgets everything."""
        self._points.clear()

    def points_S3(self) -> Array:
        """Always as many points as the capacity, newest first, the oldest repeated."""
        capacity = self._points.maxlen or 0
        if not self._points:
            return np.zeros((capacity, 3))
        points = np.array(self._points)[::-1]
        return np.concatenate([points, np.repeat(points[-1:], capacity - len(points), axis=0)])
