"""A sliding window over rows of numbers, in memory that never grows."""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.state.views import Array

NEAR_S = 0.05
"""A row nearer to another than this says nothing new."""
SAMPLES = 400
"""Kept per window: 20 s at 20 Hz. At a higher rate the window gets shorter, never the memory larger."""


class History:
    """The last ``capacity`` rows of ``columns`` values with their times; older rows are overwritten."""

    def __init__(self, columns: int, capacity: int = SAMPLES) -> None:
        self._rows = np.zeros((capacity, columns + 1))
        self._count = 0

    def __len__(self) -> int:
        return min(self._count, len(self._rows))

    @property
    def nbytes(self) -> int:
        """Memory held, constant."""
        return self._rows.nbytes

    def clear(self) -> None:
        """Forgets everything."""
        self._count = 0

    def add(self, time_s: float, values: Array) -> None:
        """Takes one row; a time before the last one (another clock: a restart) forgets what was there."""
        if len(self) and time_s < self.newest_s:
            self._count = 0
        self._rows[self._count % len(self._rows)] = (time_s, *values)
        self._count += 1

    def fill(self, time_s: float, values: Array) -> None:
        """Takes a row of an earlier time, unless there is one of about then."""
        held = self._in_order()
        if not (np.abs(held[:, 0] - time_s) < NEAR_S).any():
            rows = np.vstack([held, np.array([time_s, *values])])
            rows = rows[np.argsort(rows[:, 0], kind="stable")][-len(self._rows) :]
            self._rows[: len(rows)] = rows
            self._count = len(rows)

    def _in_order(self) -> Array:
        """The rows that are held, each with its time, the oldest first."""
        n = len(self)
        return np.roll(self._rows, -self._count, axis=0) if n == len(self._rows) else self._rows[:n]

    @property
    def newest_s(self) -> float:
        """Time of the last row; needs at least one."""
        return float(self._rows[(self._count - 1) % len(self._rows), 0])

    def window(self, seconds: float) -> tuple[Array, Array]:
        """Times relative to the newest row (<= 0), and rows x columns, of the last ``seconds``; oldest first."""
        n = len(self)
        if n == 0:
            return np.zeros(0), np.zeros((0, self._rows.shape[1] - 1))
        rows = self._in_order()
        ago = rows[:, 0] - rows[-1, 0]
        inside = ago >= -seconds
        return ago[inside], rows[inside, 1:]
