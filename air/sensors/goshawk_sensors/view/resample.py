"""From a camera's two images to the one that the policy was trained with: its field of view, its size, of one lens.

The image that goes out is a pinhole's with the view of the colour or of the depth lens. All that can be said before the
first image is a table: which source pixels lie under which of ours.

- Colour: the mean of the source pixels under ours, up to `MOST_ACROSS` by `MOST_ACROSS` of them, evenly spread.
- Colour beyond its lens, where the profile takes a narrower one: its border again.
- Depth in its own view: the measurement nearest to our pixel's centre, of nine that lie under it. Nothing is averaged,
  so nothing lies between a branch and what is behind it.
- Depth in the colour's view: its points are seen from there. Of several on one pixel the nearest hides the rest.

Shape suffixes: h w our image's rows and columns, H W the source's, N our pixels, P points, K samples of one pixel.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from goshawk_sensors.setup.errors import CameraError
from goshawk_sensors.setup.profile import Align
from goshawk_sensors.setup.vehicle import Wanted
from goshawk_sensors.view.pinhole import Floats, Lens, Rig

TOLERANCE = 0.02
"""Of the field of view: goshawk-air takes a policy's image that is off by no more."""
MOST_ACROSS = 3
"""Colour samples across one of our pixels: all of them up to 3 times our size, and evenly spread beyond."""
POINTS_ACROSS = 1.25
"""Depth points across one of our pixels, at least: with fewer, pixels are left out by chance."""
FAR_M = 20.0
"""Where a pixel without depth is thought to be when its colour is looked up."""
NONE = np.uint16(65535)

Colour = NDArray[np.uint8]
Millimetres = NDArray[np.uint16]
Index = NDArray[np.int64]


class Resampler:
    """Made once for a camera; called for each pair of images."""

    def __init__(
        self, rig: Rig, wanted: Wanted, align: Align, clip_m: tuple[float, float], *, rim: bool = False
    ) -> None:
        """Raises CameraError if the camera sees less than the policy wants, or its depth image is not rectified."""
        if rig.depth.distorted:
            raise CameraError("the depth image is not rectified: choose a mode of the camera in which it is")
        lens = rig.colour if align == "colour" else rig.depth
        if rim:
            self.hfov_rad, self.vfov_rad = wanted.hfov_rad, wanted.vfov_rad
        else:
            self.hfov_rad = _field(lens.half_x, wanted.hfov_rad, "from left to right", align)
            self.vfov_rad = _field(lens.half_y, wanted.vfov_rad, "from top to bottom", align)
        self.view = _pinhole(wanted, self.hfov_rad, self.vfov_rad)
        rows = _shown(wanted.height, self.view.fy * lens.half_y)
        columns = _shown(wanted.width, self.view.fx * lens.half_x)
        self._shown = np.ix_(rows, columns)
        self.shown = len(np.unique(rows)) * len(np.unique(columns)) / (wanted.width * wanted.height)
        """The share of our pixels that the lens sees whose view goes out: all, unless its rim is taken."""
        nearest, farthest = (round(1000.0 * each / rig.depth_unit_mm) for each in clip_m)
        self._clip = nearest, min(farthest, int(NONE) - 1)
        self._unit_mm = rig.depth_unit_mm
        parts: tuple[_Depth, _Colour] = (
            (_DepthSeenAside(rig, self.view), _ColourAhead(rig.colour, self.view))
            if align == "colour"
            else (_DepthAhead(rig.depth, self.view), _ColourSeenAside(rig, self.view))
        )
        self._depth, self._colour = parts
        self.seen = self._depth.seen
        """The share of our pixels that the depth lens sees."""

    def __call__(self, colour_HW3: Colour, depth_HW: Millimetres) -> tuple[Colour, Millimetres]:
        """Colour (h, w, 3) and depth (h, w), mm along the axis; 0 where nothing was measured."""
        shape = self.view.height, self.view.width
        steps_N = self._depth(depth_HW, *self._clip)
        mm_N = steps_N if self._unit_mm == 1.0 else np.rint(steps_N * self._unit_mm).clip(0, 65535).astype(np.uint16)
        sent_hw3 = self._colour(colour_HW3, mm_N).reshape(*shape, 3)
        return sent_hw3 if self.shown == 1.0 else sent_hw3[self._shown], mm_N.reshape(shape)


class _Depth(Protocol):
    seen: float

    def __call__(self, depth_HW: Millimetres, nearest: int, farthest: int) -> Millimetres: ...


class _Colour(Protocol):
    def __call__(self, colour_HW3: Colour, mm_N: Millimetres) -> Colour: ...


class _DepthAhead:
    """Depth in its own view: a table of nine source pixels for each of ours, the one in the middle first."""

    def __init__(self, lens: Lens, view: Lens) -> None:
        uv_KN2 = _under(lens, view, 3)
        inside = (np.abs(uv_KN2[4] - _middle(lens)) <= _middle(lens) + 0.5).all(axis=1)
        self.seen = float(inside.mean())
        centre_out = np.argsort([abs(k % 3 - 1) + abs(k // 3 - 1) for k in range(9)], kind="stable")
        self._index_KN = _indices(lens, uv_KN2)[centre_out]

    def __call__(self, depth_HW: Millimetres, nearest: int, farthest: int) -> Millimetres:
        flat = depth_HW.reshape(-1)
        steps_N = _taken(flat, self._index_KN[0], nearest, farthest)
        for index_N in self._index_KN[1:]:
            missing = np.flatnonzero(steps_N == 0)
            if missing.size == 0:
                break
            steps_N[missing] = _taken(flat, index_N[missing], nearest, farthest)
        return steps_N


class _DepthSeenAside:
    """Depth from where the colour lens is: every so many points of it, moved there, the nearest of each pixel kept."""

    def __init__(self, rig: Rig, view: Lens) -> None:
        lens = rig.depth
        self._stride = max(1, int(min(lens.fx / view.fx, lens.fy / view.fy) / POINTS_ACROSS))
        v_HW, u_HW = np.mgrid[0 : lens.height : self._stride, 0 : lens.width : self._stride].astype(np.float32)
        rays_P3 = lens.rays(u_HW.reshape(-1), v_HW.reshape(-1))
        self._view = view
        # In our pixels from the axis, before the division by the distance.
        focal_3 = np.array([view.fx, view.fy, 1.0], dtype=np.float32)
        self._rays_3P = np.ascontiguousarray((rays_P3 @ rig.rotation_33.T * focal_3).T)
        self._move_3 = rig.translation_3 * focal_3 * np.float32(1000.0 / rig.depth_unit_mm)
        ahead_N3 = _rays(view) @ rig.rotation_33  # at infinity, in the depth's frame
        front = ahead_N3[:, 2] > 0.0
        uv_N2 = lens.project(ahead_N3[front])
        self.seen = float((np.abs(uv_N2 - _middle(lens)) <= _middle(lens) + 0.5).all(axis=1).sum() / len(ahead_N3))

    def __call__(self, depth_HW: Millimetres, nearest: int, farthest: int) -> Millimetres:
        steps_P = depth_HW[:: self._stride, :: self._stride].reshape(-1)
        x, y, z = (steps_P * ray_P + move for ray_P, move in zip(self._rays_3P, self._move_3, strict=True))
        view = self._view
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = x / z + np.float32(view.cx + 0.5), y / z + np.float32(view.cy + 0.5)
            kept_P = (u >= 0) & (u < view.width) & (v >= 0) & (v < view.height) & (z >= 1.0)
        kept_P &= (steps_P >= max(nearest, 1)) & (steps_P <= farthest)
        kept = np.flatnonzero(kept_P)
        index_P = v.take(kept).astype(np.int64) * view.width + u.take(kept).astype(np.int64)
        steps_N = np.full(view.width * view.height, NONE)
        np.minimum.at(steps_N, index_P, np.rint(z.take(kept)).clip(1, int(NONE) - 1).astype(np.uint16))
        steps_N[steps_N == NONE] = 0
        return steps_N


class _ColourAhead:
    """Colour in its own view: a table of the source pixels under each of ours."""

    def __init__(self, lens: Lens, view: Lens) -> None:
        self._index_KN = _indices(lens, _under(lens, view, _across(lens, view)))

    def __call__(self, colour_HW3: Colour, mm_N: Millimetres) -> Colour:
        return _mean(colour_HW3, self._index_KN, *self._index_KN.shape)


class _ColourSeenAside:
    """Colour from where the depth lens is: each of our pixels, at its depth, looked up in the colour image."""

    def __init__(self, rig: Rig, view: Lens) -> None:
        lens = rig.colour
        self._lens, self._move_3 = lens, rig.translation_3
        self._rays_N3 = _rays(view) @ rig.rotation_33.T
        across = _across(lens, view)
        reach = max(1.0, lens.fx / view.fx), max(1.0, lens.fy / view.fy)
        du, dv = (np.rint((np.arange(across) + 0.5) / across * each - 0.5).astype(np.int64) for each in reach)
        self._steps = (dv[:, None] * lens.width + du).reshape(-1)
        self._half = np.array([0.5 * each - 1.0 for each in reach], dtype=np.float32)
        self._last = lens.width - 1 - int(du[-1]), lens.height - 1 - int(dv[-1])

    def __call__(self, colour_HW3: Colour, mm_N: Millimetres) -> Colour:
        z_m = np.where(mm_N == 0, np.float32(FAR_M), mm_N * np.float32(0.001))
        first_N2 = (self._lens.project(self._rays_N3 * z_m[:, None] + self._move_3) - self._half).astype(np.int64)
        corner_N = first_N2[:, 1].clip(0, self._last[1]) * self._lens.width + first_N2[:, 0].clip(0, self._last[0])
        return _mean(colour_HW3, (corner_N + step for step in self._steps), len(self._steps), len(corner_N))


def _field(half: float, wanted_rad: float, way: str, align: Align) -> float:
    """Of the image that goes out: what is wanted, or the little less that the lens sees."""
    found_rad = 2.0 * math.atan(half)
    if found_rad < (1.0 - TOLERANCE) * wanted_rad:
        raise CameraError(
            f"the camera's {align} sees {math.degrees(found_rad):.1f} degrees {way}, the policy wants "
            f"{math.degrees(wanted_rad):.1f}: choose a wider mode or camera, set rim = true in the profile, or train a "
            "policy for this one"
        )
    return min(found_rad, wanted_rad)


def _shown(size: int, reach: float) -> Index:
    """For each of our rows, or columns, the nearest that a lens sees which reaches so many of them from the axis."""
    seen = max(1, int(reach + 0.5))
    return np.arange(size).clip(size // 2 - seen, size // 2 + seen - 1)


def _pinhole(wanted: Wanted, hfov_rad: float, vfov_rad: float) -> Lens:
    width, height = wanted.width, wanted.height
    fx, fy = 0.5 * width / math.tan(0.5 * hfov_rad), 0.5 * height / math.tan(0.5 * vfov_rad)
    return Lens(width=width, height=height, fx=fx, fy=fy, cx=0.5 * width - 0.5, cy=0.5 * height - 0.5)


def _rays(view: Lens, across: int = 1) -> Floats:
    """Of our pixels, or of so many parts of each from left to right and from top to bottom, row by row."""
    u = ((np.arange(view.width * across) + 0.5) / across - 0.5).astype(np.float32)
    v = ((np.arange(view.height * across) + 0.5) / across - 0.5).astype(np.float32)
    return view.rays(np.tile(u, len(v)), np.repeat(v, len(u)))


def _under(lens: Lens, view: Lens, across: int) -> Floats:
    """The source's pixels (K, N, 2) under each of ours: across x across of them."""
    uv = lens.project(_rays(view, across)).reshape(view.height, across, view.width, across, 2)
    return uv.transpose(1, 3, 0, 2, 4).reshape(across * across, view.height * view.width, 2)


def _across(lens: Lens, view: Lens) -> int:
    return max(1, min(MOST_ACROSS, math.ceil(max(lens.fx / view.fx, lens.fy / view.fy) - 1e-6)))


def _middle(lens: Lens) -> Floats:
    return np.array([0.5 * lens.width - 0.5, 0.5 * lens.height - 0.5], dtype=np.float32)


def _indices(lens: Lens, uv: Floats) -> Index:
    """Places in the flat source image; what lies outside takes the rim's."""
    u = np.floor(uv[..., 0] + 0.5).astype(np.int64).clip(0, lens.width - 1)
    v = np.floor(uv[..., 1] + 0.5).astype(np.int64).clip(0, lens.height - 1)
    return v * lens.width + u


def _taken(flat: Millimetres, index_N: Index, nearest: int, farthest: int) -> Millimetres:
    steps: Millimetres = flat.take(index_N)
    steps[(steps < nearest) | (steps > farthest)] = 0
    return steps


def _mean(colour_HW3: Colour, indices_KN: Iterable[Index], count: int, size: int) -> Colour:
    flat = colour_HW3.reshape(-1, 3)
    total_N3 = np.full((size, 3), count // 2, dtype=np.uint16)
    for index_N in indices_KN:
        total_N3 += flat.take(index_N, axis=0)
    return (total_N3 // np.uint16(count)).astype(np.uint8)
