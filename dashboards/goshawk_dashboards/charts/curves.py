"""A signal within a window of time, with no more points than its pixels can show. Pure. Shape suffix: M samples."""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.state.snapshot import SAMPLE_STALE_S
from goshawk_dashboards.state.views import Array

GAP_SAMPLES = 5.0
"""A line is broken where this many samples are missing."""
LEAST_GAP_S = 0.3


def drawn(times_s: Array, values: Array, from_s: float, to_s: float, columns: int) -> tuple[Array, Array]:
    """The line to draw: all samples, or least and greatest of each of so many columns; NaN where it is broken.

    It goes one sample beyond the window at each side, so that the line reaches the edges.
    """
    first, last = np.searchsorted(times_s, (from_s, to_s))
    first, last = max(int(first) - 1, 0), min(int(last) + 1, len(times_s))
    times_s, values = times_s[first:last], values[first:last]
    good = np.isfinite(values)
    times_s, values = times_s[good], values[good]
    if len(times_s) < 2:
        return times_s, values
    every_s = float(np.median(np.diff(times_s)))
    wide_s = (to_s - from_s) / columns
    if len(times_s) > 2 * columns:
        column = np.floor((times_s - from_s) / wide_s)
        starts = np.flatnonzero(np.diff(column, prepend=column[0] - 1.0) > 0)
        ends = np.append(starts[1:], len(times_s)) - 1
        pairs_s = np.stack([times_s[starts], times_s[ends]], axis=1).ravel()
        values = np.stack([np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)], axis=1).ravel()
        later = np.append(True, np.diff(pairs_s) > 0.0)  # a column of one sample is one point
        times_s, values = pairs_s[later], values[later]
    gap_s = max(LEAST_GAP_S, GAP_SAMPLES * every_s, 3.0 * wide_s if len(times_s) > columns else 0.0)
    breaks = np.flatnonzero(np.diff(times_s) > gap_s) + 1
    return np.insert(times_s, breaks, times_s[breaks - 1] + 1e-6), np.insert(values, breaks, np.nan)


def at(times_s: Array, values: Array, time_s: float) -> float | None:
    """The newest value at a time; None: there is none, or it is stale."""
    index = int(np.searchsorted(times_s, time_s + 1e-6, side="right")) - 1
    if index < 0 or not np.isfinite(values[index]):
        return None
    every_s = float(times_s[index] - times_s[index - 1]) if index else 0.0
    stale_s = max(SAMPLE_STALE_S, GAP_SAMPLES * every_s)
    return float(values[index]) if time_s - times_s[index] <= stale_s else None
