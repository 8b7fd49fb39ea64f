"""Sensor image to network input, the same rules as the onboard preprocessing (`tests/vectors/preprocess.json`).

Depth is integer millimetres, 0 = no measurement. Shape letters: H, W image rows and columns.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from goshawk_train.config import DepthConfig

U16 = NDArray[np.uint16]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

_NONE = np.uint16(65535)
"""Stands for "no measurement" while filling: it never wins a minimum. Longer measurements count as one less."""


def fill_depth(depth_mm: U16, config: DepthConfig) -> U16:
    """Fill holes of images [..., H, W] from the nearest of the 3x3 neighbours, `fill_passes` times.

    Each pass reads the image as it was before the pass. What still has no measurement becomes `max_m`; so do
    longer measurements. The result is in millimetres, `min_m`..=`max_m`.
    """
    near = np.uint16(round(config.min_m * 1000))
    far = np.uint16(round(config.max_m * 1000))
    out = np.where(depth_mm < near, _NONE, np.minimum(depth_mm, _NONE - np.uint16(1)))
    for _ in range(config.fill_passes):
        rows = _min3(out, axis=-2)
        out = np.where(out == _NONE, _min3(rows, axis=-1), out)
    return np.minimum(out, far)


def _min3(image: U16, *, axis: int) -> U16:
    """Minimum of each value and its two neighbours along `axis`; the border has one neighbour."""
    out = image.copy()
    lower = [slice(None)] * image.ndim
    upper = [slice(None)] * image.ndim
    lower[axis] = slice(None, -1)
    upper[axis] = slice(1, None)
    np.minimum(out[tuple(lower)], image[tuple(upper)], out=out[tuple(lower)])
    np.minimum(out[tuple(upper)], image[tuple(lower)], out=out[tuple(upper)])
    return out


def normalise_depth(filled_mm: U16, config: DepthConfig) -> F32:
    """Filled millimetres to 0..1 of `max_m`."""
    return filled_mm.astype(np.float32) / np.float32(config.max_m * 1000)


def resize_depth(depth_mm: U16, *, height: int, width: int) -> U16:
    """Take the source pixel under each target pixel's centre; before the fill."""
    rows = ((np.arange(height) + 0.5) * depth_mm.shape[0] / height).astype(np.int64)
    columns = ((np.arange(width) + 0.5) * depth_mm.shape[1] / width).astype(np.int64)
    return depth_mm[rows[:, None], columns[None, :]]


def box_weights(start: F64, stop: F64, source: int) -> F64:
    """Share of each of `source` pixels in each box from `start` to `stop` (source pixels), [boxes, source].

    Rows sum to 1; each box must overlap the image.
    """
    pixel = np.arange(source)[None, :]
    overlap = np.clip(np.minimum(stop[:, None], pixel + 1) - np.maximum(start[:, None], pixel), 0, None)
    return overlap / overlap.sum(axis=1, keepdims=True)


def resize_rgb(rgb: NDArray[np.uint8], *, height: int, width: int) -> F32:
    """Box average of [H, W, 3] in 0..255, areas weighted where the sizes do not divide."""
    if rgb.shape[:2] == (height, width):
        return rgb.astype(np.float32)
    row, column = (np.arange(to + 1) * of / to for to, of in ((height, rgb.shape[0]), (width, rgb.shape[1])))
    rows = box_weights(row[:-1], row[1:], rgb.shape[0])
    columns = box_weights(column[:-1], column[1:], rgb.shape[1])
    return np.einsum("ah,hwc,bw->abc", rows, rgb.astype(np.float64), columns).astype(np.float32)


def rgbd_tensor(rgb: NDArray[np.uint8], depth_mm: U16, *, height: int, width: int, config: DepthConfig) -> F32:
    """The network's `rgbd` input of one frame, [4, height, width]: R, G, B in 0..1, then depth in 0..1."""
    # Whole values, as on board: there the image at the network's size is what the log keeps.
    colour = np.floor(resize_rgb(rgb, height=height, width=width) + np.float32(0.5)) / np.float32(255)
    depth = normalise_depth(fill_depth(resize_depth(depth_mm, height=height, width=width), config), config)
    return np.concatenate([np.moveaxis(colour, -1, 0), depth[None]], axis=0).astype(np.float32)
