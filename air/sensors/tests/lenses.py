"""Made-up lenses, and the rigs of two of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from goshawk_sensors.view.pinhole import Lens, Rig

LEVEL = np.eye(3, dtype=np.float32)


def lens(width: int, height: int, hfov_deg: float, vfov_deg: float) -> Lens:
    """One without distortion, its axis in the middle."""
    fx = 0.5 * width / float(np.tan(0.5 * np.radians(hfov_deg)))
    fy = 0.5 * height / float(np.tan(0.5 * np.radians(vfov_deg)))
    return Lens(width=width, height=height, fx=fx, fy=fy, cx=0.5 * width - 0.5, cy=0.5 * height - 0.5)


def rig(size: tuple[int, int] = (320, 192), move_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Rig:
    """Two lenses of the policy's view; ``move_m``: the depth lens in the colour's frame."""
    one = lens(*size, 90.0, 61.93)
    return Rig(colour=one, depth=one, rotation_33=LEVEL, translation_3=np.array(move_m, dtype=np.float32))


def d435(size: tuple[int, int] = (848, 480)) -> Rig:
    """By its data sheet: colour 69 x 42 degrees, depth 87 x 58."""
    return replace(rig(), colour=lens(*size, 69.0, 42.0), depth=lens(*size, 87.0, 58.0))
