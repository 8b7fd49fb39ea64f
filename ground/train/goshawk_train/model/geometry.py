"""The lattice of anchors (eq. 3), the cells' frames and the projection; camera FLU, radians, metres, pixels.

Anchors count row-major from the image's top left. Shape letters: N anchors, 3 an FLU vector.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from goshawk_train.config import CameraConfig, LatticeConfig

F64 = NDArray[np.float64]


class Pinhole(Protocol):
    """A camera with square pixels and its axis in the image's middle."""

    @property
    def width(self) -> int:
        """Pixels across."""
        ...

    @property
    def height(self) -> int:
        """Pixels down."""
        ...

    @property
    def focal_px(self) -> float:
        """Focal length, px."""
        ...


def anchor_angles(camera: CameraConfig, lattice: LatticeConfig) -> tuple[F64, F64]:
    """Elevation (up positive) and azimuth (left positive) of each anchor, [N] each, rad."""
    column = np.arange(lattice.columns)
    row = np.arange(lattice.rows)
    azimuth = camera.hfov_rad * (0.5 - (column + 0.5) / lattice.columns)
    elevation = camera.vfov_rad * (0.5 - (row + 0.5) / lattice.rows)
    elevation_RC, azimuth_RC = np.meshgrid(elevation, azimuth, indexing="ij")
    return elevation_RC.ravel(), azimuth_RC.ravel()


def direction(elevation: F64, azimuth: F64) -> F64:
    """Unit vectors [..., 3] of eq. 3."""
    return np.stack(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=-1
    )


def rotation_y(angle: float) -> F64:
    """Right-handed rotation about y (left); a positive angle pitches the nose down."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation_z(angle: float) -> F64:
    """Right-handed rotation about z (up)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def cam_from_cell(camera: CameraConfig, lattice: LatticeConfig) -> F64:
    """Rz(phi) Ry(-theta) of each anchor, [N, 3, 3]; its first column is the anchor's direction."""
    elevation, azimuth = anchor_angles(camera, lattice)
    return np.stack([rotation_z(p) @ rotation_y(-t) for t, p in zip(elevation, azimuth, strict=True)])


def matrix_from_quaternion(wxyz: F64) -> F64:
    """Rotation matrices [..., 3, 3] of quaternions [..., 4] (w, x, y, z), normalised here."""
    w, x, y, z = np.moveaxis(wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True), -1, 0)
    rows = [
        np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
        np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
        np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
    ]
    return np.stack(rows, axis=-2)


def quaternion_from_matrix(rotation: F64) -> F64:
    """Unit quaternions [N, 4] (w, x, y, z) of rotation matrices [N, 3, 3], w not negative."""
    xyzw = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return np.roll(xyzw, 1, axis=-1)


def level_from_cam(world_from_cam: F64) -> F64:
    """The camera's attitude [..., 3, 3] with its heading taken out: Rz(-yaw) world_from_cam."""
    yaw = np.arctan2(world_from_cam[..., 1, 0], world_from_cam[..., 0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    out = np.array(world_from_cam)
    out[..., 0, :] = c[..., None] * world_from_cam[..., 0, :] + s[..., None] * world_from_cam[..., 1, :]
    out[..., 1, :] = -s[..., None] * world_from_cam[..., 0, :] + c[..., None] * world_from_cam[..., 1, :]
    return out


def project(pos_cam: F64, camera: Pinhole) -> tuple[F64, F64]:
    """Pixel coordinates (u right, v down; the image's corner is 0, 0) of points [..., 3] with x > 0."""
    u = camera.width / 2 - camera.focal_px * pos_cam[..., 1] / pos_cam[..., 0]
    v = camera.height / 2 - camera.focal_px * pos_cam[..., 2] / pos_cam[..., 0]
    return u, v


def pixel_rays(camera: Pinhole) -> F64:
    """The point at x = 1 m seen at each pixel's centre, [height, width, 3], camera frame."""
    u = np.arange(camera.width) + 0.5
    v = np.arange(camera.height) + 0.5
    v_HW, u_HW = np.meshgrid(v, u, indexing="ij")
    y = (camera.width / 2 - u_HW) / camera.focal_px
    z = (camera.height / 2 - v_HW) / camera.focal_px
    return np.stack([np.ones_like(y), y, z], axis=-1).astype(np.float64)
