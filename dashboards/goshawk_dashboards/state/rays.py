"""Where the pixels of a camera look, in its own frame: x along the optical axis, y left, z up."""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.state.views import Array

FARTHEST_M = 12.0
"""Stereo is poor beyond: what it measured there is not drawn."""


def rays_HW3(height: int, width: int, hfov_rad: float, vfov_rad: float) -> Array:
    """Of the middle of each pixel, or block of pixels; 1 along the optical axis."""
    left_W = np.tan(0.5 * hfov_rad) * (1.0 - 2.0 * (np.arange(width) + 0.5) / width)
    up_H = np.tan(0.5 * vfov_rad) * (1.0 - 2.0 * (np.arange(height) + 0.5) / height)
    return np.stack(np.broadcast_arrays(1.0, left_W[None, :], up_H[:, None]), axis=-1)
