"""A scene's obstacles as voxels, and what a camera in them should measure: the images' judge.

Shape letters: P points or pixels, T steps along a ray, 3 a world vector (ENU, m).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data.layout import Bounds, Ground

F64 = NDArray[np.float64]

VOXEL_M = 0.2
REACH_M = 12.0
"""Nothing is looked for farther along the optical axis."""
_NEAR_M = 0.3
_STEP_M = 0.1
_MARGIN_M = 1.0
_KEYS = 1 << 20
_HALF_KEY = _KEYS // 2
"""Voxels across the largest map, and half of it: 100 km each way."""


def voxel_centres(points_P3: NDArray[np.floating]) -> NDArray[np.float32]:
    """The centres of the 0.2 m voxels that hold a point, ordered by z, y, x; at odd multiples of 0.1 m."""
    index_P3 = np.floor(points_P3.astype(np.float64) / VOXEL_M).astype(np.int64) + _HALF_KEY
    keys = np.unique((index_P3[:, 2] * _KEYS + index_P3[:, 1]) * _KEYS + index_P3[:, 0])
    index = np.stack([keys % _KEYS, keys // _KEYS % _KEYS, keys // _KEYS**2], axis=-1) - _HALF_KEY
    return ((index + 0.5) * VOXEL_M).astype(np.float32)


@dataclass(frozen=True, kw_only=True)
class RayMap:
    """Occupied voxels over a ground."""

    occupied: NDArray[np.bool_]
    """Flat, x slowest."""
    shape: tuple[int, int, int]
    low: F64
    """The corner of the first voxel."""
    bounds: Bounds
    ground: Ground

    @classmethod
    def build(cls, points_P3: NDArray[np.float32], bounds: Bounds, ground: Ground) -> RayMap:
        """From obstacle points; those outside of the scene's box are left out."""
        low = np.floor(bounds.min_xyz / VOXEL_M) * VOXEL_M
        shape = np.ceil((bounds.max_xyz - low) / VOXEL_M).astype(int) + 1
        index = np.floor((points_P3 - low) / VOXEL_M).astype(int)
        index = index[((index >= 0) & (index < shape)).all(axis=1)]
        occupied = np.zeros(shape, dtype=bool)
        occupied[tuple(index.T)] = True
        size = (shape[0], shape[1], shape[2])
        return cls(occupied=occupied.ravel(), shape=size, low=low, bounds=bounds, ground=ground)

    def covers(self, pos_P3: F64) -> NDArray[np.bool_]:
        """Whether points [..., 3] lie in the scene's box, seen from above, and not far over or under it."""
        low, high = self.bounds.min_xyz - _MARGIN_M, self.bounds.max_xyz + _MARGIN_M
        return np.asarray(((pos_P3 >= low) & (pos_P3 <= high)).all(axis=-1))

    def inside(self, pos_P3: F64) -> NDArray[np.bool_]:
        """Whether points [..., 3] lie in an occupied voxel."""
        index = np.floor((pos_P3 - self.low) / VOXEL_M).astype(np.int32)
        x, y, z = np.moveaxis(index, -1, 0)
        nx, ny, nz = self.shape
        there = (x >= 0) & (x < nx) & (y >= 0) & (y < ny) & (z >= 0) & (z < nz)
        return self.occupied[np.where(there, (x * ny + y) * nz + z, 0)] & there

    def depth(self, pos_P3: F64, ray_P3: F64) -> F64:
        """Ray parameter of the first obstacle or ground from each position, [P]; inf if none within `REACH_M`.

        A ray of unit length along the optical axis gives the depth. Steps of half a voxel: right within one.
        """
        step_T = np.arange(_NEAR_M, REACH_M, _STEP_M)
        pos_PT3 = pos_P3[:, None] + step_T[:, None] * ray_P3[:, None]
        hit = self.inside(pos_PT3)
        hit |= pos_PT3[..., 2] < self._ground_below(pos_PT3)
        return np.where(hit.any(axis=1), step_T[hit.argmax(axis=1)], np.inf)

    def _ground_below(self, pos: F64) -> NDArray[np.float32]:
        """The nearest node's height: exact enough here, and three times as fast as between nodes."""
        heights = self.ground.height_YX
        node = np.rint((pos[..., :2] - self.ground.min_xy) / self.ground.cell_m).astype(np.int32)
        x = np.clip(node[..., 0], 0, heights.shape[1] - 1)
        y = np.clip(node[..., 1], 0, heights.shape[0] - 1)
        return heights[y, x]
