"""The ground's height out of a point cloud that has none apart: progressive morphological filtering.

1. The lowest point of each 0.5 m cell; a point with nothing else within 1 m around is noise and is left out.
2. Openings (a minimum, then a maximum filter) with growing windows, 1.5 to 9.5 m: a cell that stands over the opening
   by more than the window's slope allows (0.3 m + 0.15 m/m of its reach) is a trunk or a wall and is no ground.
3. What is left is spread to the other cells by distance-weighted means of the nearest, and smoothed lightly.

Where a cloud has no ground at all, the feet of trees are taken for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial import KDTree

from goshawk_train.dataset.layout import Bounds, Ground

CELL_M = 0.5
_NOISE_M = 1.0
_WINDOWS = (3, 7, 13, 19)
_STEP_M, _SLOPE = 0.3, 0.15
_NEAREST = 8


def estimate_ground(points_P3: NDArray[np.float32], bounds: Bounds) -> Ground:
    """Heights over the whole box, from at least one point."""
    shape_XY = np.ceil((bounds.max_xyz[:2] - bounds.min_xyz[:2]) / CELL_M).astype(int) + 1
    low = bounds.min_xyz[:2]
    lowest = _lowest(points_P3.astype(np.float64), low, shape_XY)
    known = np.isfinite(lowest)
    surface = _spread(lowest, known)
    for window in _WINDOWS:
        size = min(window, *surface.shape)
        opened = ndimage.grey_opening(surface, size=(size, size), mode="nearest")
        known &= lowest - opened <= _STEP_M + _SLOPE * (window - 1) / 2 * CELL_M
        surface = opened
    height_XY = _spread(lowest, known)
    smooth = ndimage.gaussian_filter(height_XY, 1.0, mode="nearest")
    return Ground(height_YX=smooth.T.astype(np.float32), min_xy=low.astype(float), cell_m=CELL_M)


def _lowest(points: NDArray[np.float64], low: NDArray[np.float64], shape_XY: NDArray[np.int64]) -> NDArray[np.float64]:
    """The lowest point around each node that is not alone, NaN without one."""
    node = np.rint((points[:, :2] - low) / CELL_M).astype(int)
    inside = ((node >= 0) & (node < shape_XY)).all(axis=1)
    points, node = points[inside], node[inside]
    order = np.lexsort((points[:, 2], node[:, 1], node[:, 0]))
    _, first = np.unique(node[order], axis=0, return_index=True)
    candidates = order[first]
    if len(points) > 1:
        second = KDTree(points).query(points[candidates], k=2)[0][:, 1]
        candidates = candidates[second < _NOISE_M] if (second < _NOISE_M).any() else candidates
    out = np.full(shape_XY, np.nan)
    out[tuple(node[candidates].T)] = points[candidates, 2]
    return out


def _spread(height_XY: NDArray[np.float64], known_XY: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Unknown heights from the nearest known ones."""
    if known_XY.all():
        return height_XY.copy()
    places = np.argwhere(known_XY)
    out = np.where(known_XY, height_XY, 0.0)
    wanted = np.argwhere(~known_XY)
    distance, index = KDTree(places).query(wanted, k=min(_NEAREST, len(places)))
    distance, index = distance.reshape(len(wanted), -1), index.reshape(len(wanted), -1)
    weight = 1 / distance**2
    values = height_XY[known_XY][index]
    out[tuple(wanted.T)] = (weight * values).sum(axis=1) / weight.sum(axis=1)
    return out
