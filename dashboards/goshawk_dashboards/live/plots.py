"""Motion and timing over a sliding window, in bounded memory: motion from control samples, timing from heartbeats.

A plot is a row of the tables below: its title, its lines, and how a snapshot gives their values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from goshawk_dashboards.instruments.chart import Line, chart_svg
from goshawk_dashboards.instruments.history import History
from goshawk_dashboards.page import theme
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array

MOTION_WINDOW_S = 20.0
TIMING_WINDOW_S = 120.0
_NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class Plot:
    """One plot: ``values`` gives as many numbers as there are ``lines``, NaN where there is nothing to draw."""

    title: str
    lines: tuple[tuple[str, theme.Rgb], ...]
    values: Callable[[Snapshot], Sequence[float]]
    least: float
    """The y axis goes from 0 to at least this."""


def _speeds(snap: Snapshot) -> Sequence[float]:
    target_seen = snap.target is not None and snap.target.confirmed and snap.fresh("target")
    return (
        _NAN if snap.control is None else float(np.linalg.norm(snap.control.vel_world_3)),
        float(np.linalg.norm(snap.target.vel_world_3)) if snap.target is not None and target_seen else _NAN,
    )


def _thrust(snap: Snapshot) -> Sequence[float]:
    return (_NAN if snap.control is None else 100.0 * snap.control.thrust_norm,)


def _plan_age(snap: Snapshot) -> Sequence[float]:
    age_s = None if snap.control is None else snap.control.plan_age_s
    return (_NAN if age_s is None else 1e3 * age_s,)


def _rates(*names: str) -> Callable[[Snapshot], Sequence[float]]:
    def values(snap: Snapshot) -> Sequence[float]:
        known = dict(snap.health.rates_hz) if snap.health is not None else {}
        return [known.get(name, _NAN) for name in names]

    return values


def _latencies(snap: Snapshot) -> Sequence[float]:
    known = {x.name: x for x in snap.health.latencies} if snap.health is not None else {}
    parts = [known.get(name) for name in ("frame_to_plan", "inference")]
    return [_NAN if x is None else value for x in parts for value in ((x.p50_ms, x.p99_ms) if x else (_NAN, _NAN))]


def _round_trip(snap: Snapshot) -> Sequence[float]:
    took_s = snap.round_trip_s
    return (_NAN if took_s is None or math.isinf(took_s) else 1e3 * took_s,)


MOTION = (
    Plot(
        title="speed, m/s: vehicle blue, target orange",
        lines=(("vehicle", theme.VEHICLE), ("target", theme.TARGET)),
        values=_speeds,
        least=5.0,
    ),
)
EFFORT = (
    Plot(title="thrust, % of full", lines=(("thrust", theme.VEHICLE),), values=_thrust, least=25.0),
    Plot(title="age of the plan flown, ms", lines=(("age", theme.VEHICLE),), values=_plan_age, least=50.0),
)
TIMING = (
    Plot(
        title="rates, Hz: camera green, planner blue",
        lines=(("camera", theme.GOOD), ("planner", theme.VEHICLE)),
        values=_rates("camera", "planner"),
        least=20.0,
    ),
    Plot(
        title="rates, Hz: controller green, odometry blue",
        lines=(("controller", theme.GOOD), ("odometry", theme.VEHICLE)),
        values=_rates("controller", "odometry"),
        least=50.0,
    ),
    Plot(
        title="frame to plan blue, its network green, p50 and p99 (pale), ms",
        lines=(
            ("frame to plan p50", theme.VEHICLE),
            ("p99", (150, 190, 235)),
            ("network p50", theme.GOOD),
            ("p99", (160, 225, 190)),
        ),
        values=_latencies,
        least=5.0,
    ),
    Plot(title="round trip over the link, ms", lines=(("rtt", theme.TARGET),), values=_round_trip, least=10.0),
)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Plots that share a window and take a row each time ``stamp_ns`` changes."""

    plots: tuple[Plot, ...]
    window_s: float
    stamp_ns: Callable[[Snapshot], int | None]


class Curves:
    """What one kind of plots shows of one vehicle: sampled once, for all who look."""

    def __init__(self, kind: Kind) -> None:
        self.kind = kind
        self._last_ns: int | None = None
        self._history = History(sum(len(plot.lines) for plot in kind.plots))

    @property
    def nbytes(self) -> int:
        """Memory held, constant."""
        return self._history.nbytes

    def sample(self, snap: Snapshot) -> None:
        """Keeps the snapshot's values, once per stamp."""
        stamp_ns = self.kind.stamp_ns(snap)
        if stamp_ns is None or stamp_ns == self._last_ns:
            return
        self._last_ns = stamp_ns
        self._history.add(stamp_ns * 1e-9, self._row(snap))

    def fill(self, snap: Snapshot) -> None:
        """Takes a snapshot of earlier, of which nothing was known."""
        stamp_ns = self.kind.stamp_ns(snap)
        if stamp_ns is not None:
            self._history.fill(stamp_ns * 1e-9, self._row(snap))

    def _row(self, snap: Snapshot) -> Array:
        return np.array([value for plot in self.kind.plots for value in plot.values(snap)])

    def charts_html(self) -> str:
        """Every plot, over the window."""
        ago, rows = self._history.window(self.kind.window_s)
        charts, first = list[str](), 0
        for plot in self.kind.plots:
            columns = rows[:, first : first + len(plot.lines)].T
            first += len(plot.lines)
            lines = [
                Line(label=label, color=color, values_S=column)
                for (label, color), column in zip(plot.lines, columns, strict=True)
            ]
            charts.append(chart_svg(plot.title, ago, lines, least=plot.least))
        return f'<div data-goshawk="charts" style="padding:4px 10px">{"".join(charts)}</div>'


def control_stamp_ns(snap: Snapshot) -> int | None:
    """When motion was sampled, by the vehicle's clock."""
    return None if snap.control is None else snap.control.stamp_ns


def health_stamp_ns(snap: Snapshot) -> int | None:
    """When timing was sampled, by the vehicle's clock."""
    return None if snap.health is None else snap.health.stamp_ns


KINDS = (
    Kind(plots=MOTION, window_s=MOTION_WINDOW_S, stamp_ns=control_stamp_ns),
    Kind(plots=EFFORT, window_s=MOTION_WINDOW_S, stamp_ns=control_stamp_ns),
    Kind(plots=TIMING, window_s=TIMING_WINDOW_S, stamp_ns=health_stamp_ns),
)
"""In the order of the panels."""
