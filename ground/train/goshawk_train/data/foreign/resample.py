"""Images of any pinhole camera to those of ours. Shape letters: H, W image rows and columns."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data import DataError
from goshawk_train.data.layout import View
from goshawk_train.data.preprocess import box_weights

F64 = NDArray[np.float64]

OURS = View(width=160, height=96, hfov_rad=math.pi / 2)
"""What the shipped policies see."""
_COVER_LEAST = 0.85


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A pinhole camera in pixels; the image's corner is 0, 0. No distortion: rectify the images first."""

    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def of(cls, width: int, height: int, hfov_rad: float) -> Intrinsics:
        """Square pixels, the axis in the middle."""
        focal = width / 2 / math.tan(hfov_rad / 2)
        return cls(fx=focal, fy=focal, cx=width / 2, cy=height / 2)


class Resampler:
    """Crops and scales images of one size and camera to a `View`.

    Colour is the average over each target pixel's box; beyond the source's border it repeats the nearest pixels.
    Depth is the source pixel under the target pixel's centre, and none beyond the border.
    """

    def __init__(self, width: int, height: int, camera: Intrinsics, view: View = OURS) -> None:
        """Raises `DataError` if the source sees less than 85 % of the view's width or height."""
        u = _edges(view.width, camera.fx / view.focal_px, camera.cx)
        v = _edges(view.height, camera.fy / view.focal_px, camera.cy)
        self.view = view
        self.size = (height, width)
        self.covered = (_inside(v, height), _inside(u, width))
        """Share of the view's rows and of its columns that the source sees."""
        if min(self.covered) < _COVER_LEAST:
            rows, columns = (100 * share for share in self.covered)
            raise DataError(
                f"images of {width} x {height} at fx {camera.fx:.0f} see only {columns:.0f} % of our width and "
                f"{rows:.0f} % of our height (90 x 62 deg): correct --hfov-deg or --fx, --fy, --cx, --cy"
            )
        self._rows = box_weights(*_pulled_in(v, height), height)
        self._columns = box_weights(*_pulled_in(u, width), width)
        self._v, self._u = ((edges[:-1] + edges[1:]) / 2 for edges in (v, u))

    def rgb(self, rgb_HW3: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Colour [H, W, 3] of the view."""
        out = np.einsum("ah,hwc,bw->abc", self._rows, rgb_HW3.astype(np.float32), self._columns, optimize=True)
        return np.rint(out).astype(np.uint8)

    def depth(self, depth_HW: NDArray[np.uint16]) -> NDArray[np.uint16]:
        """Depth [H, W] of the view."""
        height, width = depth_HW.shape
        row, column = np.floor(self._v).astype(int), np.floor(self._u).astype(int)
        seen = ((row >= 0) & (row < height))[:, None] & ((column >= 0) & (column < width))[None, :]
        picked = depth_HW[np.clip(row, 0, height - 1)[:, None], np.clip(column, 0, width - 1)[None, :]]
        return np.where(seen, picked, np.uint16(0))


def _edges(count: int, scale: float, centre: float) -> F64:
    """Where the borders between the view's pixels lie in the source, px."""
    return centre + (np.arange(count + 1, dtype=np.float64) - count / 2) * scale


def _inside(edges: F64, size: int) -> float:
    centre = (edges[:-1] + edges[1:]) / 2
    return float(((centre >= 0) & (centre < size)).mean())


def _pulled_in(edges: F64, size: int) -> tuple[F64, F64]:
    """Start and stop of each box; one beyond the image's border is moved to that border."""
    width = min(float(edges[1] - edges[0]), size)
    start = np.clip(edges[:-1], 0, size - width)
    return start, start + width
