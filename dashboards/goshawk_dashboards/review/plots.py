"""The curves of a review: whole columns once, then for each window as many points as there are pixels. Pure.

Shape suffixes: M samples, 3 a vector.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from goshawk_dashboards.log.flight import TARGET_FIELDS, Columns, Flight
from goshawk_dashboards.log.recorded import Replay
from goshawk_dashboards.page import theme
from goshawk_dashboards.state.snapshot import SAMPLE_STALE_S
from goshawk_dashboards.state.views import Array

SAMPLES = 12_000
"""Of the controller's steps at most: all of a minute, 20 a second of ten minutes."""
CONTROL_FIELDS = (
    "pos_world", "vel_world", "acc_meas_world", "acc_des_world", "acc_disturbance_world", "plan_age_s",
)  # fmt: skip
COLUMNS = 340
"""Pixels that a plot is wide, about: finer than that nothing can be seen."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """One line: values over time, NaN where there is none."""

    label: str
    rgb: theme.Rgb
    times_s: Array
    values: Array
    dashed: bool = False

    def at(self, time_s: float) -> float | None:
        """The newest value at a time; None: there is none, or it is stale."""
        index = int(np.searchsorted(self.times_s, time_s + 1e-6, side="right")) - 1
        if index < 0 or time_s - self.times_s[index] > SAMPLE_STALE_S or not np.isfinite(self.values[index]):
            return None
        return float(self.values[index])

    def shifted(self, by_s: float) -> Curve:
        """The same, later."""
        return replace(self, times_s=self.times_s + by_s)

    def envelope(self, from_s: float, to_s: float, columns: int = COLUMNS) -> tuple[Array, Array, Array]:
        """Time, least and greatest value of each pixel column of a window that has any; ascending."""
        first, last = np.searchsorted(self.times_s, (from_s, to_s))
        good = np.flatnonzero(np.isfinite(self.values[first:last])) + first
        if len(good) == 0:
            return np.zeros(0), np.zeros(0), np.zeros(0)
        column = np.floor((self.times_s[good] - from_s) / (to_s - from_s) * columns)
        starts = np.flatnonzero(np.diff(column, prepend=-1.0) > 0)
        values = self.values[good]
        return (
            self.times_s[good][starts],
            np.minimum.reduceat(values, starts),
            np.maximum.reduceat(values, starts),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Plot:
    """Curves over the same time that share a unit."""

    title: str
    curves: tuple[Curve, ...]
    from_zero: bool
    """Whether zero is always within its range."""
    digits: int = 1
    """Digits behind the point that its values are shown with."""


def plots_of(flight: Flight, replay: Replay | None, second: Flight | None, second_by_s: float) -> tuple[Plot, ...]:
    """All plots of a flight, with those of a second one ``second_by_s`` later laid over where they can be compared."""
    plots = [
        _plot("speed, m/s", _speeds(flight), second, _own_speed, second_by_s),
        _plot("to the target, m", _distances(flight), second, _estimated_distance, second_by_s),
        _plot("clearance, m", [_clearance(flight, theme.GOOD)], second, _clearance, second_by_s, digits=2),
        _plot("cost of what was flown", _costs(flight, replay), second, _cost, second_by_s, digits=2),
        *(_acceleration(flight, axis, name) for axis, name in enumerate(("east", "north", "up"))),
        Plot(title="age of the plan, ms", curves=(_plan_age(flight),), from_zero=True, digits=0),
    ]  # fmt: skip
    return tuple(p for p in plots if any(np.isfinite(c.values).any() for c in p.curves))


def _control(flight: Flight) -> Columns:
    hz = SAMPLES / max(flight.duration_s, 1.0)
    return flight.columns("control", CONTROL_FIELDS, max_hz=hz if hz < 200.0 else None)


def _plot(
    title: str,
    curves: Sequence[Curve],
    second: Flight | None,
    of_second: Callable[[Flight, theme.Rgb], Curve],
    by_s: float,
    digits: int = 1,
) -> Plot:
    if second is not None:
        curves = [*curves, of_second(second, theme.SECOND).shifted(by_s)]
    return Plot(title=title, curves=tuple(curves), from_zero=True, digits=digits)


def _speeds(flight: Flight) -> list[Curve]:
    target = flight.columns("target", TARGET_FIELDS)
    speed = np.linalg.norm(target["vel_world"], axis=1)
    held = np.where(target["confirmed"].astype(bool), speed, np.nan)
    return [
        _own_speed(flight, theme.VEHICLE),
        Curve(label="target", rgb=theme.TARGET, times_s=target.times_s, values=held),
    ]


def _own_speed(flight: Flight, rgb: theme.Rgb) -> Curve:
    own = _control(flight)
    return Curve(label="vehicle", rgb=rgb, times_s=own.times_s, values=np.linalg.norm(own["vel_world"], axis=1))


def _distances(flight: Flight) -> list[Curve]:
    truth = flight.columns("sim_truth", ["target_distance_m"])
    true = Curve(label="true", rgb=theme.TRUTH, times_s=truth.times_s, values=truth["target_distance_m"])
    return [true, _estimated_distance(flight, theme.TARGET)]


def _estimated_distance(flight: Flight, rgb: theme.Rgb) -> Curve:
    own = _control(flight)
    target = flight.columns("target", TARGET_FIELDS)
    distance_M = np.full(len(target), np.nan)
    if len(own) > 0 and len(target) > 0:
        there_M3 = np.stack(
            [np.interp(target.times_s, own.times_s, own["pos_world"][:, axis]) for axis in range(3)], axis=1
        )
        distance_M = np.linalg.norm(target["pos_world"] - there_M3, axis=1)
        distance_M[~target["confirmed"].astype(bool)] = np.nan
    return Curve(label="estimated", rgb=rgb, times_s=target.times_s, values=distance_M)


def _clearance(flight: Flight, rgb: theme.Rgb) -> Curve:
    truth = flight.columns("sim_truth", ["clearance_m"])
    return Curve(label="clearance", rgb=rgb, times_s=truth.times_s, values=truth["clearance_m"])


def _costs(flight: Flight, replay: Replay | None) -> list[Curve]:
    own = [_cost(flight, theme.GOOD)]
    if replay is None:
        return own
    times_s, values = replay.log.chosen_cost
    return [*own, Curve(label="replay", rgb=theme.REPLAY, times_s=times_s, values=values)]


def _cost(flight: Flight, rgb: theme.Rgb) -> Curve:
    times_s, values = flight.chosen_cost
    return Curve(label="cost", rgb=rgb, times_s=times_s, values=values)


def _acceleration(flight: Flight, axis: int, name: str) -> Plot:
    own, truth = _control(flight), flight.columns("sim_truth", ["acc_world"])
    curves = [
        Curve(label=label, rgb=rgb, times_s=own.times_s, values=own[field][:, axis])
        for field, label, rgb in (
            ("acc_meas_world", "measured", theme.MEASURED),
            ("acc_des_world", "des.", theme.GOOD),
            ("acc_disturbance_world", "dist.", theme.DISTURBANCE),
        )
    ]
    felt = np.isfinite(curves[0].values).any()
    true = Curve(label="true", rgb=theme.TRUTH, times_s=truth.times_s, values=truth["acc_world"][:, axis], dashed=True)
    shown = (*(curves if felt else curves[1:]), *([true] if np.isfinite(true.values).any() else []))
    return Plot(title=f"acc. {name}, m/s²" + ("" if felt else ", no IMU"), curves=shown, from_zero=True)


def _plan_age(flight: Flight) -> Curve:
    age = _control(flight)
    return Curve(label="age", rgb=theme.VEHICLE, times_s=age.times_s, values=1e3 * age["plan_age_s"])
