"""The ground's height out of a point cloud that holds it, by morphological filters.

1. The lowest point of each 0.5 m cell. A pit of less than 2.5 m across and more than 0.3 m deep, found by a closing (a
   maximum, then a minimum filter), is noise or the foot of a modelled trunk and is left out.
2. Openings (a minimum, then a maximum filter) with growing windows, 1.5 to 9.5 m: a cell that stands over the opening
   by more than a window allows (0.3 m + 0.05 m/m of its reach) is a trunk or a wall and is left out.
3. What is left is spread to the other cells by distance-weighted means of the nearest, and smoothed lightly.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from goshawk_train.data.layout import Bounds, Ground

F64 = NDArray[np.float64]

CELL_M = 0.5
_PIT_WINDOW = 5
_WINDOWS = (3, 7, 13, 19)
_STEP_M, _SLOPE = 0.3, 0.05
_NEAREST = 8


def estimate_ground(points_P3: NDArray[np.float32], bounds: Bounds) -> tuple[Ground, float]:
    """Heights over the whole box, and the share of its cells that show ground; from at least one point."""
    shape_XY = np.ceil((bounds.max_xyz[:2] - bounds.min_xyz[:2]) / CELL_M).astype(int) + 1
    low = bounds.min_xyz[:2]
    lowest = _lowest(points_P3.astype(np.float64), low, shape_XY)
    known = np.isfinite(lowest)
    surface = _spread(lowest, known)
    pit = min(_PIT_WINDOW, *surface.shape)
    closed = cast("F64", ndimage.grey_closing(surface, size=(pit, pit), mode="nearest"))
    known &= closed - surface <= _STEP_M
    surface = _spread(lowest, known)
    for window in _WINDOWS:
        size = min(window, *surface.shape)
        opened = cast("F64", ndimage.grey_opening(surface, size=(size, size), mode="nearest"))
        known &= surface - opened <= _STEP_M + _SLOPE * (window - 1) / 2 * CELL_M
        surface = opened
    height_XY = _spread(lowest, known)
    smooth = cast("F64", ndimage.gaussian_filter(height_XY, 1.0, mode="nearest"))
    ground = Ground(height_YX=smooth.T.astype(np.float32), min_xy=low.astype(float), cell_m=CELL_M)
    return ground, float(known.mean())


def _lowest(points: F64, low: F64, shape_XY: NDArray[np.int64]) -> F64:
    """The lowest point around each node, NaN without one."""
    node = np.rint((points[:, :2] - low) / CELL_M).astype(int)
    inside = ((node >= 0) & (node < shape_XY)).all(axis=1)
    points, node = points[inside], node[inside]
    order = np.lexsort((points[:, 2], node[:, 1], node[:, 0]))
    _, first = np.unique(node[order], axis=0, return_index=True)
    lowest = order[first]
    out = np.full(shape_XY, np.nan)
    out[tuple(node[lowest].T)] = points[lowest, 2]
    return out


def _spread(height_XY: F64, known_XY: NDArray[np.bool_]) -> F64:
    """Unknown heights from the nearest known ones."""
    if known_XY.all():
        return height_XY.copy()
    places = np.argwhere(known_XY)
    out = np.where(known_XY, height_XY, 0.0)
    wanted = np.argwhere(~known_XY)
    tree = cast("Any", KDTree(places))
    distance, index = cast("tuple[F64, NDArray[np.int64]]", tree.query(wanted, k=min(_NEAREST, len(places))))
    distance, index = distance.reshape(len(wanted), -1), index.reshape(len(wanted), -1)
    weight = 1 / distance**2
    values = height_XY[known_XY][index]
    out[tuple(wanted.T)] = (weight * values).sum(axis=1) / weight.sum(axis=1)
    return out
