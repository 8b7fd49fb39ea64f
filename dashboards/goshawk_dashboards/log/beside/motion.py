"""How a vehicle moved, as two logs of one flight tell it alike whatever their frames: tilt and speed. Pure.

Shape suffixes: M samples, 3 a vector, 4 a quaternion (w, x, y, z).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from goshawk_dashboards.state.views import Array

Series = tuple[Array, Array]
"""Times, s, ascending, and values."""

LONGEST_S = 43_200.0
"""A time that is farther than this from a log's middle is damage; a grid that reached there would fill the memory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion:
    """Of one log, by its own clock."""

    tilt_deg: Series
    """Between the body's and the world's vertical axes: the same in NED with FRD and in ENU with FLU."""
    speed_mps: Series

    @classmethod
    def of(cls, attitude: tuple[Array, Array], velocity: tuple[Array, Array]) -> Motion:
        """Of times and quaternions (M x 4), and of times and velocities (M x 3)."""
        times_s, q_M4 = attitude
        cosine_M = 1.0 - 2.0 * (q_M4[:, 1] ** 2 + q_M4[:, 2] ** 2)
        tilt_M = np.degrees(np.arccos(np.clip(cosine_M, -1.0, 1.0)))
        return cls(tilt_deg=_good(times_s, tilt_M), speed_mps=_good(velocity[0], np.linalg.norm(velocity[1], axis=1)))


def _good(times_s: Array, values_M: Array) -> Series:
    """What is finite, in the order of time, one value a time."""
    times_s, values_M = np.asarray(times_s, dtype=np.float64), np.asarray(values_M, dtype=np.float64)
    good_M = np.isfinite(times_s) & np.isfinite(values_M)
    if good_M.any():
        good_M &= np.abs(times_s - np.median(times_s[good_M])) <= LONGEST_S
    times_s, first = np.unique(times_s[good_M], return_index=True)
    return times_s, values_M[good_M][first]
