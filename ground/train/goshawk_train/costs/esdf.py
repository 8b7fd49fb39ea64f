"""Signed distance fields and ground heights of all scenes in flat tensors, and their lookups.

Shape letters: P points, S scenes, 3 a world-frame vector (ENU, m).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

VOXEL_M = 0.2
ESDF_VERSION = 1
"""Counts changes of the field's definition, for what is kept on disk."""
FAR_VOXELS = 16
DEEP_VOXELS = 8


def signed_distance(occupied_XYZ: NDArray[np.bool_], *, voxel_m: float) -> NDArray[np.float32]:
    """Distance of each voxel's centre to the obstacles' surface, m; negative inside.

    The surface is taken to pass through the centres of the outermost occupied voxels: the point cloud holds each
    voxel whose centre is inside or within half a voxel of an obstacle, so those centres lie on the surface on
    average, and the field has slope one across it. Exact from -DEEP_VOXELS to FAR_VOXELS, constant beyond: the
    potential is flat there, and it makes this six times faster than an unlimited transform.
    """
    outside = _distance(occupied_XYZ, FAR_VOXELS)
    inside = _distance(~occupied_XYZ, DEEP_VOXELS)
    return (outside - np.maximum(inside - 1, 0)) * np.float32(voxel_m)


def _distance(seed_XYZ: NDArray[np.bool_], reach: int) -> NDArray[np.float32]:
    """Euclidean distance to the nearest seed in voxels, at most `reach`: one pass of parabola minima an axis."""
    square = np.where(seed_XYZ, np.uint16(0), np.uint16(reach * reach))
    for axis in range(3):
        best = square.copy()
        for offset in range(1, min(reach, square.shape[axis])):
            ahead: list[slice] = [slice(None)] * 3
            behind: list[slice] = [slice(None)] * 3
            ahead[axis], behind[axis] = slice(offset, None), slice(None, -offset)
            shifted = square + np.uint16(offset * offset)
            np.minimum(best[tuple(ahead)], shifted[tuple(behind)], out=best[tuple(ahead)])
            np.minimum(best[tuple(behind)], shifted[tuple(ahead)], out=best[tuple(behind)])
        square = best
    return np.sqrt(square, dtype=np.float32)


@dataclass(frozen=True, kw_only=True)
class SceneGrid:
    """One scene's privileged map."""

    distance_XYZ: NDArray[np.float32] | NDArray[np.float16]
    distance_origin: NDArray[np.float64]
    """World position of the centre of voxel (0, 0, 0)."""
    ground_XY: NDArray[np.float32]
    ground_origin: NDArray[np.float64]
    """World x, y of the first height."""
    ground_cell_m: float


def grid_from_points(
    points_P3: NDArray[np.float32], *, min_xyz: NDArray[np.float64], max_xyz: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Distance field of obstacle points at the centres of a 0.2 m grid, and the centre of its first voxel.

    The grid's phase is taken from the points; it covers min_xyz..max_xyz. Raises `ValueError` for an empty box.
    """
    span = max_xyz - min_xyz
    if not (span > 0).all():
        raise ValueError(f"scene bounds are empty: {min_xyz} .. {max_xyz}")
    anchor = points_P3[0].astype(np.float64) if len(points_P3) else min_xyz
    origin = anchor - np.ceil((anchor - min_xyz) / VOXEL_M - 1e-3) * VOXEL_M
    shape = np.maximum(np.ceil((max_xyz - origin) / VOXEL_M).astype(int) + 1, 2)
    index = np.rint((points_P3 - origin) / VOXEL_M).astype(int)
    inside = ((index >= 0) & (index < shape)).all(axis=1)
    occupied = np.zeros(shape, dtype=bool)
    occupied[tuple(index[inside].T)] = True
    return signed_distance(occupied, voxel_m=VOXEL_M), origin


class _Trilinear(torch.autograd.Function):
    """Value of a flat grid at points, with the exact gradient of the interpolation."""

    @staticmethod
    def forward(ctx: Any, *args: Any) -> Tensor:
        point_P3, flat, base_P, shape_P3, origin_P3, inverse_voxel = args
        coordinate = (point_P3 - origin_P3) * inverse_voxel
        last = (shape_P3 - 1).to(coordinate.dtype)
        inside = (coordinate >= 0) & (coordinate <= last)
        clamped = torch.minimum(coordinate.clamp_min(0), last)
        low = torch.minimum(clamped.floor(), last - 1)
        x, y, z = (clamped - low).unbind(1)
        i, j, k = low.long().unbind(1)
        stride_y = shape_P3[:, 2]
        stride_x = shape_P3[:, 1] * stride_y
        corner = base_P + i * stride_x + j * stride_y + k
        offsets = torch.stack(
            [dx * stride_x + dy * stride_y + dz for dx in (0, 1) for dy in (0, 1) for dz in (0, 1)], 1
        )
        c = flat[corner[:, None] + offsets].to(point_P3.dtype).view(-1, 2, 2, 2)
        along_z = torch.lerp(c[..., 0], c[..., 1], z[:, None, None])
        slope_z = c[..., 1] - c[..., 0]
        along_y = torch.lerp(along_z[..., 0], along_z[..., 1], y[:, None])
        slope_y = along_z[..., 1] - along_z[..., 0]
        slope_zy = torch.lerp(slope_z[..., 0], slope_z[..., 1], y[:, None])
        value = torch.lerp(along_y[:, 0], along_y[:, 1], x)
        gradient = torch.stack(
            [
                along_y[:, 1] - along_y[:, 0],
                torch.lerp(slope_y[:, 0], slope_y[:, 1], x),
                torch.lerp(slope_zy[:, 0], slope_zy[:, 1], x),
            ],
            dim=1,
        )
        ctx.save_for_backward(gradient * inverse_voxel * inside)
        return value

    @staticmethod
    def backward(ctx: Any, *grad_outputs: Any) -> Any:
        (gradient_P3,) = ctx.saved_tensors
        return gradient_P3 * grad_outputs[0][:, None], None, None, None, None, None


class SceneMaps:
    """The maps of all scenes: one flat half-precision tensor, an offset, a shape and an origin for each."""

    def __init__(self, grids: list[SceneGrid], *, storage: torch.dtype = torch.float16) -> None:
        sizes = [g.distance_XYZ.size for g in grids]
        self.distance = torch.empty(sum(sizes), dtype=storage)
        parts = cast("tuple[Tensor, ...]", self.distance.split(sizes))
        for part, grid in zip(parts, grids, strict=True):
            part.numpy()[:] = grid.distance_XYZ.ravel()
        self.base_S = _starts(sizes)
        self.shape_S3 = torch.tensor([g.distance_XYZ.shape for g in grids])
        self.origin_S3 = torch.tensor(np.array([g.distance_origin for g in grids]))
        self.height = torch.cat([torch.from_numpy(g.ground_XY).flatten() for g in grids])
        self.height_base_S = _starts([g.ground_XY.size for g in grids])
        self.height_shape_S2 = torch.tensor([g.ground_XY.shape for g in grids])
        self.height_origin_S2 = torch.tensor(np.array([g.ground_origin for g in grids]))
        self.height_cell_S = torch.tensor([g.ground_cell_m for g in grids], dtype=torch.float64)

    def to(self, device: torch.device) -> SceneMaps:
        """The same maps on another device."""
        for name, value in vars(self).items():
            setattr(self, name, value.to(device))
        return self

    def clearance(self, pos_world_P3: Tensor, scene_P: Tensor) -> Tensor:
        """Signed distance to the obstacles, m, [P]; differentiable. Outside of the map: that of its nearest border."""
        origin = self.origin_S3[scene_P].to(pos_world_P3.dtype)
        result: Any = _Trilinear.apply(
            pos_world_P3, self.distance, self.base_S[scene_P], self.shape_S3[scene_P], origin, 1 / VOXEL_M
        )
        return result

    def ground(self, pos_world_P3: Tensor, scene_P: Tensor) -> Tensor:
        """Height of the ground under the points, m, [P]; bilinear, no gradient."""
        with torch.no_grad():
            dtype = pos_world_P3.dtype
            shape = self.height_shape_S2[scene_P]
            cell = self.height_cell_S[scene_P].to(dtype)[:, None]
            coordinate = (pos_world_P3[:, :2] - self.height_origin_S2[scene_P].to(dtype)) / cell
            last = (shape - 1).to(dtype)
            clamped = torch.minimum(coordinate.clamp_min(0), last)
            low = torch.minimum(clamped.floor(), last - 1)
            x, y = (clamped - low).unbind(1)
            i, j = low.long().unbind(1)
            stride = shape[:, 1]
            at = self.height_base_S[scene_P] + i * stride + j
            near = torch.lerp(self.height[at].to(dtype), self.height[at + 1].to(dtype), y)
            far = torch.lerp(self.height[at + stride].to(dtype), self.height[at + stride + 1].to(dtype), y)
            return torch.lerp(near, far, x)


def _starts(sizes: list[int]) -> Tensor:
    return torch.tensor([0, *np.cumsum(sizes)[:-1].tolist()])
