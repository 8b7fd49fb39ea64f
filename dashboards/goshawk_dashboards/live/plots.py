"""Sliding-window plots in bounded memory: motion from control samples, timing from heartbeats.

A plot is a row of the tables below: its title, its lines, and how a snapshot gives their values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from goshawk_dashboards.instruments.history import History
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.viewer import Viewer
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array

MOTION_WINDOW_S = 20.0
TIMING_WINDOW_S = 120.0
ACC_STEP_MPS2, ACC_MOST_MPS2 = 4.0, 24.0
"""Steps of an acceleration's axis, and where it ends: what is more is a knock."""
TRUE = "true"
"""Of a simulation; it is dashed."""
_NAN = float("nan")


@dataclass(frozen=True, kw_only=True)
class Plot:
    """One plot: ``values`` gives as many numbers as there are ``lines``, NaN where there is nothing to draw."""

    title: str
    lines: tuple[tuple[str, theme.Rgb], ...]
    values: Callable[[Snapshot], Sequence[float]]
    step: float
    """The y axis goes from 0 to a multiple of this."""
    most: float = math.inf
    """Where the axis ends at the latest."""
    signed: bool = False
    """The axis goes as far below 0 as above."""


def _true_acceleration(snap: Snapshot) -> Array | None:
    return snap.truth.acc_world_3 if snap.truth is not None and snap.fresh("sim_truth") else None


def _acceleration(axis: int) -> Callable[[Snapshot], Sequence[float]]:
    def values(snap: Snapshot) -> Sequence[float]:
        c = snap.control
        own = (None,) * 4 if c is None else (c.acc_des_world_3, c.acc_att_world_3, c.acc_disturbance_world_3,
                                             c.acc_meas_world_3)  # fmt: skip
        return [_NAN if acc_3 is None else float(acc_3[axis]) for acc_3 in (*own, _true_acceleration(snap))]

    return values


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


ACCELERATIONS: tuple[tuple[str, theme.Rgb], ...] = (
    ("desired", theme.GOOD),
    ("attitude", theme.VEHICLE),
    ("disturbance", theme.DISTURBANCE),
    ("measured", theme.MEASURED),
    (TRUE, theme.TRUTH),
)
MOTION = tuple(
    Plot(
        title=f"acceleration {name}, m/s\u00b2",
        lines=ACCELERATIONS,
        values=_acceleration(axis),
        step=ACC_STEP_MPS2,
        most=ACC_MOST_MPS2,
        signed=True,
    )
    for axis, name in enumerate(("east", "north", "up"))
) + (
    Plot(
        title="speed, m/s: vehicle blue, target orange",
        lines=(("vehicle", theme.VEHICLE), ("target", theme.TARGET)),
        values=_speeds,
        step=5.0,
    ),
)
EFFORT = (
    Plot(title="thrust, % of full", lines=(("thrust", theme.VEHICLE),), values=_thrust, step=25.0),
    Plot(title="age of the plan flown, ms", lines=(("age", theme.VEHICLE),), values=_plan_age, step=50.0),
)
TIMING = (
    Plot(
        title="rates, Hz: camera green, planner blue",
        lines=(("camera", theme.GOOD), ("planner", theme.VEHICLE)),
        values=_rates("camera", "planner"),
        step=20.0,
    ),
    Plot(
        title="rates, Hz: controller green, odometry blue",
        lines=(("controller", theme.GOOD), ("odometry", theme.VEHICLE)),
        values=_rates("controller", "odometry"),
        step=50.0,
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
        step=5.0,
    ),
    Plot(title="round trip over the link, ms", lines=(("rtt", theme.TARGET),), values=_round_trip, step=10.0),
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
        values = [value for plot in self.kind.plots for value in plot.values(snap)]
        self._history.add(stamp_ns * 1e-9, np.array(values))

    def window(self) -> tuple[Array, Array]:
        """Times relative to the newest row, and the rows."""
        return self._history.window(self.kind.window_s)


class PlotGroup:
    """The plots of one kind in one viewer's window."""

    def __init__(self, viewer: Viewer, tab: viser.GuiTabHandle, kind: Kind) -> None:
        self._viewer = viewer
        self._tab = tab
        self._plots = kind.plots
        self._tops = [plot.step for plot in kind.plots]
        with tab:
            self.handles = [_add(viewer, plot, plot.step) for plot in kind.plots]

    def draw(self, curves: Curves) -> None:
        """Sends the window to the viewer."""
        ago, rows = curves.window()
        if len(ago) < 2:
            return
        first = 0
        for k, plot in enumerate(self._plots):
            lines = rows[:, first : first + len(plot.lines)]
            first += len(plot.lines)
            self._raise(k, plot, lines)
            self.handles[k].data = (ago, *(np.ascontiguousarray(column) for column in lines.T))

    def clear(self) -> None:
        """Shows nothing: another vehicle's curves are to be drawn next, once it has some."""
        for plot, handle in zip(self._plots, self.handles, strict=True):
            handle.data = _nothing(plot)

    def _raise(self, k: int, plot: Plot, lines: Array) -> None:
        """uPlot cannot find the range of a line with gaps by itself, and viser's plot loses its data when its range is
        changed: a new one takes its place. In steps, and never down, so that this is rare."""
        sizes = np.abs(lines) if plot.signed else lines
        largest = float(np.nanmax(sizes)) if np.isfinite(sizes).any() else 0.0
        top = min(float(np.ceil(largest / plot.step)) * plot.step, plot.most)
        if top > self._tops[k]:
            self._tops[k] = top
            with self._tab:
                fresh = _add(self._viewer, plot, top, order=self.handles[k].order)
            self.handles[k].remove()
            self.handles[k] = fresh


def _nothing(plot: Plot) -> tuple[Array, ...]:
    return (np.array([-1.0, 0.0]), *(np.zeros(2) for _ in plot.lines))


def _add(viewer: Viewer, plot: Plot, top: float, order: float | None = None) -> viser.GuiUplotHandle:
    line = {"show": True, "stroke": "#2a303b", "width": 1.0}
    axis: uplot.Axis = {"stroke": "#8b95a5", "grid": line, "ticks": line, "font": "11px system-ui", "gap": 2.0}  # type: ignore[typeddict-item]
    series: list[uplot.Series] = [{"label": "s"}]
    for label, color in plot.lines:
        row: uplot.Series = {"label": label, "stroke": theme.css(color), "width": 1.5, "points": {"show": False}}
        if label == TRUE:
            row["dash"] = (3.0, 3.0)
        series.append(row)
    return viewer.gui.add_uplot(
        data=_nothing(plot),
        series=tuple(series),
        title=plot.title,
        scales={"x": {"time": False}, "y": {"range": (-top if plot.signed else 0.0, top)}},
        order=order,
        axes=({**axis, "size": 22.0, "space": 40.0}, {**axis, "size": 38.0, "space": 20.0}),
        legend={"show": False},
        height=86,
        padding=(4, 10, 0, 0),
    )


def legend_html(snap: Snapshot) -> str:
    """What the colours of the accelerations mean, of those that there are."""
    absent: dict[str, str] = {}
    if snap.control is not None and snap.control.acc_meas_world_3 is None:
        absent["measured"] = " (no IMU)"
    shown = [pair for pair in ACCELERATIONS if pair[0] != TRUE or _true_acceleration(snap) is not None]
    return (
        '<div data-goshawk="accelerations" '
        'style="font:11px system-ui;color:#aab3c0;padding:2px 8px;display:flex;flex-wrap:wrap;gap:2px 9px">'
        + "".join(
            f'<span><span style="display:inline-block;width:10px;height:3px;border-radius:2px;vertical-align:middle;'
            f'background:{theme.css(c)}"></span> {name}{absent.get(name, "")}</span>'
            for name, c in shown
        )
        + "</div>"
    )


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
