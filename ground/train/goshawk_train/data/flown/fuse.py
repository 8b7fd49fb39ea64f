"""The map of a flight, fused from its depth images along its poses.

Each measurement says that its voxel is filled, that what lies before it is free, and that what lies right behind it is
hidden. A voxel is an obstacle where enough images filled it, set against those that saw through it; so is one that was
hidden behind a surface and never seen: a trunk is seen from one side only, and a shell alone would let the trainer's
trajectories end inside. All else that was never seen counts as free, as the simulator's maps have it outside of a
world; `Fused.known` says what was seen, and who chooses frames asks it.

Shape letters: F images, P points, H, W image rows and columns, X, Y, Z voxels, 3 a world vector (ENU, m).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data import DataError
from goshawk_train.data.foreign.ground import estimate_ground
from goshawk_train.data.layout import Bounds, Ground, View
from goshawk_train.data.raymap import VOXEL_M
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

ABOVE_GROUND_M = 0.3
"""What is lower than this over the ground is the ground, not an obstacle."""
_NEAR_M, _FAR_M = 0.4, 10.0
"""Depth between these is fused: stereo is good there, and no trajectory ends farther away."""
_GROUND_FAR_M = 6.0
_MARGIN_M = 11.0
_BELOW_M, _ABOVE_M = 4.0, 6.0
"""The box goes so far beyond the camera's positions: to the sides, down and up."""
_STRIDE_PX = 2
"""Every second row and column tells what is free."""
_SHORT = 0.96
"""What is nearer than this share of a depth, less a voxel, is free: noise must not wear surfaces away."""
_BEHIND_M = 0.4
_HITS_LEAST, _HITS_SHARE = 2, 0.3
"""Images that filled a voxel, and their share of all that filled it or saw through it."""
_TARGET_M, _TARGET_DOWN_M, _TARGET_UP_M = 0.9, 1.3, 1.1
"""The target's surroundings, from its centre: to the sides, down and up. What is measured there is the target."""
_GROUND_LEAST = 0.02


@dataclass(frozen=True, kw_only=True)
class Fused:
    """A stretch's map."""

    points_P3: NDArray[np.float32]
    """The centres of its obstacles' voxels."""
    ground: Ground
    bounds: Bounds
    low: F64
    """The corner of voxel 0, 0, 0 of `seen_XYZ`."""
    seen_XYZ: NDArray[np.bool_]

    def known(self, pos_P3: F64) -> NDArray[np.bool_]:
        """Whether the flight saw what is at these points [..., 3]; what is beyond the box it did not."""
        index = np.floor((pos_P3 - self.low) / VOXEL_M).astype(np.int64)
        inside: NDArray[np.bool_] = np.asarray(((index >= 0) & (index < self.seen_XYZ.shape)).all(axis=-1))
        x, y, z = np.moveaxis(index * inside[..., None], -1, 0)
        return self.seen_XYZ[x, y, z] & inside


class Fusion:
    """Depth images put into voxels one by one."""

    def __init__(self, view: View, pos_F3: F64) -> None:
        margin = np.array([_MARGIN_M, _MARGIN_M, _BELOW_M]), np.array([_MARGIN_M, _MARGIN_M, _ABOVE_M])
        self.low = np.floor((pos_F3.min(axis=0) - margin[0]) / VOXEL_M) * VOXEL_M
        self.shape = np.ceil((pos_F3.max(axis=0) + margin[1] - self.low) / VOXEL_M).astype(int)
        count = math.prod(self.shape.tolist())
        self.filled, self.through, self.hidden = (np.zeros(count, dtype=np.uint16) for _ in range(3))
        self.points, self.height_sum = np.zeros(count, dtype=np.uint32), np.zeros(count, dtype=np.float32)
        """Of measurements near enough to tell the ground: how many, and the sum of their heights."""
        self.rays_HW3 = geometry.pixel_rays(view)

    def add(self, depth_HW: NDArray[np.uint16], pos_3: F64, world_from_cam_33: F64, target_3: F64 | None) -> None:
        """One image; `target_3` is where the target's centre was then, if that is known."""
        depth = depth_HW / 1000
        good = (depth >= _NEAR_M) & (depth <= _FAR_M)
        ray_P3, depth_P = self.rays_HW3[good] @ world_from_cam_33.T, depth[good]
        point_P3 = pos_3 + depth_P[:, None] * ray_P3
        stands = np.ones(len(point_P3), dtype=bool) if target_3 is None else ~_at_target(point_P3, target_3)
        filled = self._voxels(point_P3[stands])
        place = np.unique(filled)
        self.filled[place] += 1
        near = stands & (depth_P <= _GROUND_FAR_M)
        of = self._voxels(point_P3[near], keep=True)
        inside = of >= 0
        np.add.at(self.points, of[inside], 1)
        np.add.at(self.height_sum, of[inside], point_P3[near][inside, 2].astype(np.float32))
        behind = [point_P3[stands] + extra * ray_P3[stands] for extra in (_BEHIND_M / 2, _BEHIND_M)]
        hidden = np.setdiff1d(np.concatenate([self._voxels(p) for p in behind]), place)
        self.hidden[hidden] += 1
        some = np.zeros_like(good)
        some[::_STRIDE_PX, ::_STRIDE_PX] = True
        free = np.setdiff1d(self._before(pos_3, ray_P3[some[good]], depth_P[some[good]]), place)
        self.through[free] += 1

    def _before(self, pos_3: F64, ray_P3: F64, depth_P: F64) -> NDArray[np.int64]:
        """The voxels between the camera and what it measured."""
        free_P = depth_P * _SHORT - VOXEL_M
        step_T = np.arange(_NEAR_M, _FAR_M, VOXEL_M * 0.75)
        ray, step = np.nonzero(step_T[None] < free_P[:, None])
        return self._voxels(pos_3 + step_T[step, None] * ray_P3[ray])

    def _voxels(self, point_P3: F64, *, keep: bool = False) -> NDArray[np.int64]:
        """Each point's voxel; those outside of the box are left out, or -1 if all are to be kept."""
        index = np.floor((point_P3 - self.low) / VOXEL_M).astype(np.int64)
        inside = ((index >= 0) & (index < self.shape)).all(axis=1)
        flat = (index[:, 0] * self.shape[1] + index[:, 1]) * self.shape[2] + index[:, 2]
        return np.where(inside, flat, -1) if keep else flat[inside]

    def result(self) -> Fused:
        """The map so far; raises `DataError` if it shows no ground."""
        places = np.flatnonzero(self.points)
        cloud = self._centres(places)
        cloud[:, 2] = self.height_sum[places] / self.points[places]
        solid = self.points[places] >= _HITS_LEAST
        if not solid.any():
            raise DataError("no depth to make a map of")
        seen = (self.filled > 0) | (self.through > 0)
        size = (int(self.shape[0]), int(self.shape[1]), int(self.shape[2]))
        bounds = Bounds(min_xyz=self.low, max_xyz=self.low + self.shape * VOXEL_M)
        ground, shown = estimate_ground(cloud[solid].astype(np.float32), bounds)
        if shown < _GROUND_LEAST:
            raise DataError("the ground is never seen: its map has no heights")
        filled = (self.filled >= _HITS_LEAST) & (self.filled >= _HITS_SHARE * (self.filled + self.through))
        shadow = (self.hidden >= _HITS_LEAST) & ~seen
        points = self._centres(np.flatnonzero(filled | shadow))
        points = points[points[:, 2] > ground.at(points) + ABOVE_GROUND_M]
        return Fused(
            points_P3=points.astype(np.float32), ground=ground, bounds=bounds, low=self.low, seen_XYZ=seen.reshape(size)
        )

    def _centres(self, flat: NDArray[np.int64]) -> F64:
        index = np.stack(np.unravel_index(flat, self.shape), axis=-1)
        return self.low + (index + 0.5) * VOXEL_M


def _at_target(point_P3: F64, target_3: F64) -> NDArray[np.bool_]:
    off = point_P3 - target_3
    flat = np.hypot(off[:, 0], off[:, 1]) < _TARGET_M
    return flat & (off[:, 2] > -_TARGET_DOWN_M) & (off[:, 2] < _TARGET_UP_M)
