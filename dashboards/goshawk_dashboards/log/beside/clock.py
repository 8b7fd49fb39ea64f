"""Which second of another log is which of ours: found by the motion that both of them hold. Pure.

First the offset by the best correlation of tilt and speed at any shift, then offset and drift by least squares.
Shape suffixes: M samples, S shifts, K signals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from goshawk_dashboards.log.beside.motion import Motion, Series
from goshawk_dashboards.state.views import Array

RATE_HZ = 50.0
"""Of the samples that are compared: attitudes come at 30 Hz and more."""
LEAST_OVERLAP_S = 5.0
"""Less motion than this could lie anywhere."""
LEAST_CORRELATION = 0.8
"""Logs of one flight reach 0.99, with half a degree of noise as well; those of two flights stayed below 0.6."""
SURE_S, SURE = 15.0, 0.97
"""What overlaps by less may be alike by chance, as two parts of one flight that correlated by 0.968."""
LEAST_LEAD = 0.05
"""By so much the best shift must be better than any that is ``APART_S`` away: else the motion repeats itself."""
APART_S = 2.0
MOST_DRIFT = 0.02
"""A quartz is true to 0.0001; the rest is for simulators that lag: a PX4 that simulated itself did by 0.006."""
STEPS = 20
SPREAD = (0.5, 0.1)
"""Standard deviations of tilt (°) and speed (m/s) below which a signal is noise, and is not compared."""


class ClockError(ValueError):
    """No clock fits; one line."""


@dataclass(frozen=True, kw_only=True)
class Clock:
    """Their time to ours: ours = (1 + ``drift``) (theirs - ``begin_s``)."""

    begin_s: float
    """What their clock says at our second 0."""
    drift: float
    """How much slower theirs goes."""
    correlation: float
    tilt_rms_deg: float
    speed_rms_mps: float
    overlap_s: float

    def ours_s(self, theirs_s: Array) -> Array:
        """Their times by our clock."""
        return (1.0 + self.drift) * (theirs_s - self.begin_s)

    @property
    def words(self) -> str:
        """The fit in a line."""
        return (
            f"its {self.begin_s:.3f} s is the flight's 0, drift {1e6 * self.drift:+.0f} ppm; "
            f"over {self.overlap_s:.0f} s {self.tilt_rms_deg:.2f}° of tilt and {self.speed_rms_mps:.2f} m/s are left, "
            f"correlation {self.correlation:.3f}"
        )


def fit(ours: Motion, theirs: Motion) -> Clock:
    """Raises ClockError if the motions are too short, do not move, or do not belong to each other."""
    pairs = [
        (a, b)
        for a, b, least in zip(_signals(ours), _signals(theirs), SPREAD, strict=True)
        if min(_span_s(a), _span_s(b)) >= LEAST_OVERLAP_S and min(np.std(a[1]), np.std(b[1])) >= least
    ]
    if not pairs:
        raise ClockError(f"no clock fits: the logs do not share {LEAST_OVERLAP_S:.0f} s of motion")
    shift_s, best = _shift(pairs)
    if best < LEAST_CORRELATION:
        raise ClockError(
            f"no clock fits: tilt and speed correlate by {best:.2f} at the best, {LEAST_CORRELATION:g} is needed; "
            "is it another flight?"
        )
    offset_s, drift = _refined(pairs, shift_s)
    if abs(drift) > MOST_DRIFT:
        raise ClockError(f"no clock fits: its drift would be {1e6 * drift:.0f} ppm, {1e6 * MOST_DRIFT:.0f} at the most")
    return _judged(ours, theirs, pairs, offset_s, drift)


def _signals(motion: Motion) -> tuple[Series, Series]:
    return motion.tilt_deg, motion.speed_mps


def _span_s(series: Series) -> float:
    return float(series[0][-1] - series[0][0]) if len(series[0]) > 1 else 0.0


def _shift(pairs: list[tuple[Series, Series]]) -> tuple[float, float]:
    """How much later their clock's zero is on ours, s, and the mean correlation there."""
    begin_s = [min(pair[k][0][0] for pair in pairs) for k in (0, 1)]
    end_s = [max(pair[k][0][-1] for pair in pairs) for k in (0, 1)]
    grids = [np.arange(begin, end, 1.0 / RATE_HZ) for begin, end in zip(begin_s, end_s, strict=True)]
    found_KS = np.stack([_correlations(*(_on(grid, s) for grid, s in zip(grids, pair, strict=True))) for pair in pairs])
    mean_S = found_KS.mean(axis=0)
    best = int(np.argmax(mean_S))
    shifts_S = (np.arange(len(mean_S)) - (len(grids[1]) - 1)) / RATE_HZ
    apart_S = np.abs(shifts_S - shifts_S[best]) > APART_S
    rival = float(mean_S[apart_S].max()) if apart_S.any() else -1.0
    if mean_S[best] >= LEAST_CORRELATION and rival > mean_S[best] - LEAST_LEAD:
        raise ClockError("no clock fits: the motion repeats itself, so that several would")
    return float(begin_s[0] - begin_s[1] + shifts_S[best]), float(mean_S[best])


def _on(grid_M: Array, series: Series) -> Array:
    """At the grid's times; NaN where the signal has none."""
    return np.interp(grid_M, *series, left=np.nan, right=np.nan)


def _correlations(ours_M: Array, theirs_M: Array) -> Array:
    """Pearson's of what overlaps, at each shift of theirs; -1 where too little does."""
    size = 1 << int(np.ceil(np.log2(len(ours_M) + len(theirs_M))))
    shifts = len(ours_M) + len(theirs_M) - 1

    def across(a_M: Array, b_M: Array) -> Array:
        """Σ a(t + shift) b(t), the shift from -(len(b) - 1) on."""
        product = np.fft.rfft(a_M, size) * np.conj(np.fft.rfft(b_M, size))
        return np.roll(np.fft.irfft(product, size), len(b_M) - 1)[:shifts]

    has_a, has_b = (np.isfinite(x).astype(np.float64) for x in (ours_M, theirs_M))
    # Around zero, and of unit size, so that nothing is lost in the sums.
    a, b = (np.nan_to_num((x - np.nanmean(x)) / np.nanstd(x)) for x in (ours_M, theirs_M))
    count = across(has_a, has_b)
    enough = count >= LEAST_OVERLAP_S * RATE_HZ
    n = np.where(enough, count, 1.0)
    mean_a, mean_b = across(a, has_b) / n, across(has_a, b) / n
    var_a, var_b = across(a * a, has_b) / n - mean_a**2, across(has_a, b * b) / n - mean_b**2
    # Where nothing moves nothing is told: a hundredth of the whole signal's spread is still.
    moves = enough & (var_a > 1e-4) & (var_b > 1e-4)
    scale = np.sqrt(np.where(moves, var_a * var_b, 1.0))
    return np.where(moves, (across(a, b) / n - mean_a * mean_b) / scale, -1.0)


def _refined(pairs: list[tuple[Series, Series]], offset_s: float) -> tuple[float, float]:
    """Offset and drift of the least squares: Gauss-Newton on both signals, each by its spread."""
    drift = 0.0
    middle_s = float(np.mean([0.5 * (theirs[0][0] + theirs[0][-1]) for _, theirs in pairs]))
    at_middle_s = offset_s + middle_s
    for _ in range(STEPS):
        rows: list[Array] = []
        lefts: list[Array] = []
        for ours, theirs in pairs:
            since_M = theirs[0] - middle_s
            here_M = at_middle_s + (1.0 + drift) * since_M
            step_s = 0.5 / RATE_HZ
            value, before, after = (_on(here_M + by, ours) for by in (0.0, -step_s, step_s))
            slope = (after - before) / (2.0 * step_s)
            good = np.isfinite(slope) & np.isfinite(value)
            spread = float(np.std(ours[1]))
            rows.append(np.stack([slope, slope * since_M], axis=1)[good] / spread)
            lefts.append((theirs[1] - value)[good] / spread)
        jacobian, left = np.concatenate(rows), np.concatenate(lefts)
        if len(left) < 2:
            break
        change, *_ = np.linalg.lstsq(jacobian, left, rcond=None)
        at_middle_s, drift = at_middle_s + float(change[0]), drift + float(change[1])
        if abs(change[0]) < 1e-7 and abs(change[1]) < 1e-9:
            break
    return at_middle_s - (1.0 + drift) * middle_s, drift


def _judged(ours: Motion, theirs: Motion, pairs: list[tuple[Series, Series]], offset_s: float, drift: float) -> Clock:
    """With what is left, and the correlation by the fitted clock."""
    lefts: list[float] = []
    overlap_s = 0.0
    for mine, other in zip(_signals(ours), _signals(theirs), strict=True):
        if len(mine[0]) == 0 or len(other[0]) == 0:
            lefts.append(float("nan"))
            continue
        here_M = offset_s + (1.0 + drift) * other[0]
        value_M = _on(here_M, mine)
        good_M = np.isfinite(value_M)
        lefts.append(float(np.sqrt(np.mean((other[1] - value_M)[good_M] ** 2))) if good_M.any() else float("nan"))
        overlap_s = max(overlap_s, float(np.ptp(here_M[good_M])) if good_M.any() else 0.0)
    correlation = float(np.mean([_pearson(mine, other, offset_s, drift) for mine, other in pairs]))
    needed = LEAST_CORRELATION if overlap_s >= SURE_S else SURE
    if not correlation >= needed:
        raise ClockError(
            f"no clock fits: with the best one tilt and speed correlate by {correlation:.2f} over {overlap_s:.0f} s, "
            f"{needed:g} is needed"
        )
    return Clock(
        begin_s=-offset_s / (1.0 + drift),
        drift=drift,
        correlation=correlation,
        tilt_rms_deg=lefts[0],
        speed_rms_mps=lefts[1],
        overlap_s=overlap_s,
    )


def _pearson(ours: Series, theirs: Series, offset_s: float, drift: float) -> float:
    value_M = _on(offset_s + (1.0 + drift) * theirs[0], ours)
    good_M = np.isfinite(value_M)
    return float(np.corrcoef(value_M[good_M], theirs[1][good_M])[0, 1]) if good_M.sum() > 2 else float("nan")
