"""Sliding-window plots of acceleration per axis and of speed, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser
from viser import uplot

from goshawk_dashboards import theme
from goshawk_dashboards.snapshot import Array, ControlView, Snapshot

WINDOW_S = 20.0
SAMPLES = 400
"""Kept per plot, 20 s at 20 Hz; at a higher rate the window gets shorter, never the memory larger."""

_SERIES: tuple[tuple[str, theme.Rgb, Callable[[ControlView], Array]], ...] = (
    ("desired", theme.GOOD, lambda c: c.acc_des_world_3),
    ("attitude", theme.VEHICLE, lambda c: c.acc_att_world_3),
    ("disturbance", theme.DISTURBANCE, lambda c: c.acc_disturbance_world_3),
    ("measured", (205, 211, 220), lambda c: c.acc_meas_world_3),
)


_SPEED_STEP_MPS = 5.0
_AT_LEAST_4: uplot.Scale = {
    "range": {"min": {"pad": 0.1, "soft": -4.0, "mode": 1}, "max": {"pad": 0.1, "soft": 4.0, "mode": 1}}
}
"""A y axis of at least -4 .. 4 that grows with the data."""


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

    def add(self, time_s: float, values: Array) -> None:
        """Takes one row; a time before the last one (another clock: a restart) forgets what was there."""
        if len(self) and time_s < self.newest_s:
            self._count = 0
        self._rows[self._count % len(self._rows)] = (time_s, *values)
        self._count += 1

    @property
    def newest_s(self) -> float:
        """Time of the last row; needs at least one."""
        return float(self._rows[(self._count - 1) % len(self._rows), 0])

    def window(self, seconds: float) -> tuple[Array, Array]:
        """Times relative to the newest row (<= 0), and rows x columns, of the last ``seconds``; oldest first."""
        n = len(self)
        if n == 0:
            return np.zeros(0), np.zeros((0, self._rows.shape[1] - 1))
        rows = (
            np.roll(self._rows, -self._count, axis=0)[len(self._rows) - n :] if n == len(self._rows) else self._rows[:n]
        )
        ago = rows[:, 0] - rows[-1, 0]
        inside = ago >= -seconds
        return ago[inside], rows[inside, 1:]


class LivePlots:
    """Three acceleration plots and one of speed, fed by control samples in the vehicle's own time."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._history = History(len(_SERIES) * 3 + 2)
        self._stamp_ns: int | None = None
        self._speed_top_mps = _SPEED_STEP_MPS
        acc_series: tuple[uplot.Series, ...] = (
            _time_series(),
            *(_series(name, color) for name, color, _ in _SERIES),
        )
        self._acc = [
            _plot(server, f"acceleration {axis}, m/s\u00b2", acc_series, _AT_LEAST_4)
            for axis in ("east", "north", "up")
        ]
        self._speed = _plot(
            server,
            "speed, m/s: vehicle blue, target orange",
            (_time_series(), _series("vehicle", theme.VEHICLE), _series("target", theme.TARGET)),
            {"range": (0.0, _SPEED_STEP_MPS)},
        )

    @property
    def nbytes(self) -> int:
        """Memory held by the history, constant."""
        return self._history.nbytes

    def sample(self, snap: Snapshot) -> None:
        """Keeps the snapshot's control sample, once."""
        control = snap.control
        if control is None or control.stamp_ns == self._stamp_ns:
            return
        self._stamp_ns = control.stamp_ns
        target_speed = (
            float(np.linalg.norm(snap.target.vel_world_3))
            if snap.target is not None and snap.target.confirmed and snap.fresh("target", 1.0)
            else float("nan")
        )
        accs = np.concatenate([get(control) for _, _, get in _SERIES])
        speed = float(np.linalg.norm(control.vel_world_3))
        self._history.add(control.stamp_ns * 1e-9, np.array([*accs, speed, target_speed]))

    def draw(self) -> None:
        """Sends the window to the viewers."""
        ago, rows = self._history.window(WINDOW_S)
        if len(ago) < 2:
            return
        for axis, plot in enumerate(self._acc):
            plot.data = (ago, *(np.ascontiguousarray(rows[:, 3 * k + axis]) for k in range(len(_SERIES))))
        # The plot cannot find the range of a series with gaps by itself; steps, because a new range redraws it whole.
        top = max(1.0, np.ceil(np.nanmax(rows[:, -2:]) / _SPEED_STEP_MPS)) * _SPEED_STEP_MPS
        if top != self._speed_top_mps:
            self._speed_top_mps = top
            self._speed.scales = _scales({"range": (0.0, float(top))})
        self._speed.data = (ago, np.ascontiguousarray(rows[:, -2]), np.ascontiguousarray(rows[:, -1]))


def _time_series() -> uplot.Series:
    return {"label": "s"}


def _series(label: str, color: theme.Rgb) -> uplot.Series:
    return {"label": label, "stroke": theme.css(color), "width": 1.5, "points": {"show": False}}


def _scales(y_scale: uplot.Scale) -> dict[str, uplot.Scale]:
    return {"x": {"time": False}, "y": y_scale}


def _plot(
    server: viser.ViserServer,
    title: str,
    series: tuple[uplot.Series, ...],
    y_scale: uplot.Scale,
) -> viser.GuiUplotHandle:
    line = {"show": True, "stroke": "#2a303b", "width": 1.0}
    axis: uplot.Axis = {"stroke": "#8b95a5", "grid": line, "ticks": line, "font": "11px system-ui", "gap": 2.0}  # type: ignore[typeddict-item]
    return server.gui.add_uplot(
        data=tuple(np.array([-1.0, 0.0]) if k == 0 else np.zeros(2) for k in range(len(series))),
        series=series,
        title=title,
        scales=_scales(y_scale),
        axes=({**axis, "size": 22.0, "space": 40.0}, {**axis, "size": 38.0, "space": 20.0}),
        legend={"show": False},
        height=100,
        padding=(4, 10, 0, 0),
    )
