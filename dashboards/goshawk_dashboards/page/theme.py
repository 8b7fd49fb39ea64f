"""Colours of the dashboards, one place: dark ground, and a hue keeps its meaning in scene, plots and panels.

RGB 0..255. Green is what is flown, amber and red are worse, blue is the vehicle, orange is the target, violet is
the disturbance, pink is a second flight, yellow what another policy would have flown, grey is rejected or stale.
"""

from __future__ import annotations

import colorsys

import numpy as np
from numpy.typing import NDArray

Rgb = tuple[int, int, int]

GOOD: Rgb = (64, 214, 138)
WARN: Rgb = (245, 188, 66)
BAD: Rgb = (240, 82, 96)
VEHICLE: Rgb = (86, 170, 255)
TARGET: Rgb = (255, 146, 64)
DISTURBANCE: Rgb = (186, 132, 255)
TRUTH: Rgb = (236, 240, 245)
MEASURED: Rgb = (205, 211, 220)
REJECTED: Rgb = (92, 101, 115)
STALE: Rgb = (110, 116, 125)
TRUNK: Rgb = (112, 88, 68)
FOLIAGE: Rgb = (74, 124, 84)
WALL: Rgb = (128, 136, 148)
MOVING: Rgb = (222, 196, 92)
REMEMBERED: Rgb = (60, 130, 150)
DEPTH: Rgb = (160, 190, 205)
SECOND: Rgb = (255, 112, 190)
REPLAY: Rgb = (250, 236, 90)
GROUND: Rgb = (74, 86, 74)
GRID: Rgb = (44, 50, 60)
GRID_SECTION: Rgb = (104, 116, 108)
BACKGROUND: Rgb = (17, 20, 26)


def vivid(rgb: Rgb) -> Rgb:
    """The colour for the 3-D view, whose tone mapping pales what is not saturated."""
    hue, saturation, value = colorsys.rgb_to_hsv(*(c / 255.0 for c in rgb))
    red, green, blue = colorsys.hsv_to_rgb(hue, min(1.0, 1.45 * saturation), value)
    return int(255 * red), int(255 * green), int(255 * blue)


def css(rgb: Rgb, alpha: float = 1.0) -> str:
    """A colour as CSS."""
    return f"rgba({rgb[0]},{rgb[1]},{rgb[2]},{alpha:g})"


COST_STEPS = 8
"""Colours from the cheapest to the dearest: as many meshes at most are what candidates are drawn as."""
_COST_STOPS = np.array([vivid(GOOD), vivid(WARN), vivid(BAD)], dtype=np.float64)


def cost_colors_N3(cost_N: NDArray[np.float64]) -> NDArray[np.uint8]:
    """In steps from green for the cheapest through amber to red for the dearest of these; all green if they cost the
    same."""
    if len(cost_N) == 0:
        return np.zeros((0, 3), dtype=np.uint8)
    span = float(np.ptp(cost_N))
    place_N = (cost_N - cost_N.min()) / span if span > 1e-9 else np.zeros(len(cost_N))
    place_N = np.round(place_N * (COST_STEPS - 1)) / (COST_STEPS - 1)
    stops = np.linspace(0.0, 1.0, len(_COST_STOPS))
    return np.stack([np.interp(place_N, stops, _COST_STOPS[:, k]) for k in range(3)], axis=1).astype(np.uint8)
