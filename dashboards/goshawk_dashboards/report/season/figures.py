"""What changed from flight to flight: a point a flight, in their order, a colour for each vehicle and policy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import MaxNLocator

from goshawk_dashboards.report.canvas import HALF_IN, Figure, Palette, legend, plain
from goshawk_dashboards.state.views import Array

NEIGHBOURS = 7
"""Flights of one kind whose median is the trend."""
MOST_KINDS = 5
"""Kinds of flights with a colour of their own; all others share one."""
NARROW_KINDS = 2
"""Of these so many stand side by side on a phone."""
OTHERS = "others"
_MARGIN = 0.6

Flights = Sequence[dict[str, Any]]


@dataclass(frozen=True, kw_only=True)
class Trend:
    """What is followed from flight to flight."""

    name: str
    column: str
    title: str
    unit: str
    caption: str
    whole: bool = False
    """It is counted."""


TRENDS = (
    Trend(
        name="clearance", column="clearance_m", title="Clearance", unit="m",
        caption="The least of each flight on its task: from the hull by the simulator, without one from the vehicle's "
        "middle by the camera's depth.",
    ),
    Trend(
        name="disturbance", column="disturbance_mps2", title="Disturbance", unit="m/s²",
        caption="The mean of each flight on its task, as the observer estimated it.",
    ),
    Trend(
        name="faults", column="fault_count", title="Faults", unit="in a flight", whole=True,
        caption="How many different warnings, errors and fallbacks each flight logged.",
    ),
)  # fmt: skip


def kind(flight: dict[str, Any]) -> str:
    """A vehicle with a policy, in a word or two."""
    return f"{flight['vehicle'] or 'unknown'} {flight['policy'] or 'unknown'}"


def figures(flights: Flights) -> list[Figure]:
    """A figure for each trend that at least one flight tells."""
    return [_figure(trend, flights) for trend in TRENDS if any(f[trend.column] is not None for f in flights)]


def narrow(figure: Figure) -> Figure:
    """The same for a phone's width."""
    return replace(figure, name=f"{figure.name}-narrow", size_in=(HALF_IN, 3.2))


def _figure(trend: Trend, flights: Flights) -> Figure:
    value_F = np.array([np.nan if f[trend.column] is None else f[trend.column] for f in flights], dtype=np.float64)
    good_F = np.array([f["good"] for f in flights], dtype=bool)
    kinds = [kind(f) for f in flights]
    most = sorted(set(kinds), key=lambda name: (-kinds.count(name), name))
    named = most if len(most) <= MOST_KINDS else most[: MOST_KINDS - 1]
    kind_F = np.array([name if name in named else OTHERS for name in kinds])
    number_F = np.arange(1.0, len(flights) + 1)

    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        colors = (palette.vehicle, palette.target, palette.success, palette.lost, palette.timeout)
        drawn = [*named, *([OTHERS] if len(named) < len(most) else [])]
        for name, color in zip(drawn, colors, strict=False):
            of_F = (kind_F == name) & np.isfinite(value_F)
            if of_F.any():
                _points(axes, number_F[of_F], value_F[of_F], good_F[of_F], color, palette, plain(name))
        axes.set_xlim(1 - _MARGIN, len(flights) + _MARGIN)
        axes.set_ylim(bottom=min(0.0, float(np.nanmin(value_F))))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if trend.whole:
            axes.yaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
        axes.set_ylabel(f"{trend.title.lower()}, {trend.unit}")
        axes.set_xlabel("flight")
        legend(axes, MOST_KINDS if canvas.get_figwidth() > HALF_IN else NARROW_KINDS)

    table = {"flight": number_F, "kind": kind_F, "good": good_F, trend.column: value_F}
    note = f" Hollow: it did not end well. The line is the median of {NEIGHBOURS} flights of one vehicle and policy."
    return Figure(
        name=trend.name,
        title=trend.title,
        caption=trend.caption + note,
        size_in=(10.0, 2.9),
        draw=draw,
        tables={trend.name: table},
    )


def _points(axes: Axes, number_F: Array, value_F: Array, good_F: Any, color: str, palette: Palette, name: str) -> None:
    axes.plot(number_F, running_median(value_F), color=color, lw=1.6, label=name)
    look: dict[str, Any] = {"marker": "o", "ms": 5, "mec": color, "ls": "none", "clip_on": False}
    axes.plot(number_F[good_F], value_F[good_F], mfc=color, **look)
    axes.plot(number_F[~good_F], value_F[~good_F], mfc=palette.paper, **look)


def running_median(value_F: Array) -> Array:
    """Of each value and its neighbours, as many on either side."""
    half = NEIGHBOURS // 2
    reach = [min(half, k, len(value_F) - 1 - k) for k in range(len(value_F))]
    return np.array([np.median(value_F[k - n : k + n + 1]) for k, n in enumerate(reach)])
