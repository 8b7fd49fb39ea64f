"""Distributions, a row for each cell: their shape above, the middle 50 % and 90 % as bars, the median as a ring."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.ticker import LogLocator, NullLocator

from goshawk_dashboards.report.campaign.data import Campaign, Pool
from goshawk_dashboards.report.campaign.tables import number
from goshawk_dashboards.report.canvas import HALF_IN, Figure, Palette, plain
from goshawk_dashboards.state.views import Array

FEW = 120
"""Fewer values than this are drawn one by one."""
BINS = 120
SMOOTH_BINS = 1.6
"""Width of the kernel that smooths the bins."""
PLACES = (5.0, 25.0, 50.0, 75.0, 95.0)
TALL = 0.62
"""Of a row, for the shape."""
LOG_FROM = 8.0
"""Greatest over least value from which an axis is by powers of ten, where a quantity allows it."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What is distributed."""

    name: str
    title: str
    unit: str
    caption: str
    values: Callable[[Pool], Array]
    logarithmic: bool = False
    from_zero: bool = True
    band: float | None = None
    """Lines at plus and minus this."""


def _samples(name: str) -> Callable[[Pool], Array]:
    return lambda pool: pool.samples[name]


def _flights(read: Callable[[Any], float | None]) -> Callable[[Pool], Array]:
    def values(pool: Pool) -> Array:
        found = (read(flight) for flight in pool.cell.flights)
        return np.array([value for value in found if value is not None], dtype=float)

    return values


ALL = "20 times a second, in all flights."
QUANTITIES = (
    Quantity(name="distance", title="Distance to the target", unit="m", caption=ALL, values=_samples("distance")),
    Quantity(name="speed", title="Speed", unit="m/s", caption=ALL, values=_samples("speed")),
    Quantity(
        name="closest_approach", title="Closest approach", unit="m",
        caption="One value a flight, from the vehicle's hull to the nearest obstacle. At 0 it touched.",
        values=_flights(lambda f: None if f.clearance_m is None else max(f.clearance_m, 0.0)),
    ),
    Quantity(
        name="clearance", title="Clearance", unit="m",
        caption=f"To the nearest obstacle, {ALL} More than 10 m counts as 10 m.", values=_samples("clearance"),
    ),
    Quantity(
        name="in_view", title="Time in view", unit="%",
        caption="One value a flight: frames that show the target, of all frames.",
        values=_flights(lambda f: None if f.in_view_fraction is None else 100.0 * f.in_view_fraction),
    ),
    Quantity(
        name="smoothness", title="Smoothness, ∫ jerk²", unit="m²/s⁵", logarithmic=True, from_zero=False,
        caption="One value a flight, of the true motion's 20 ms means. Less is smoother.",
        values=_flights(lambda f: f.jerk_integral if f.jerk_integral > 0.0 else None),
    ),
    Quantity(
        name="error_lateral", title="Lateral error of the target's estimate", unit="m", from_zero=False, band=0.5,
        caption="Across the line of sight, in each frame with an estimate.", values=_samples("lateral"),
    ),
    Quantity(
        name="error_longitudinal", title="Longitudinal error of the target's estimate", unit="m", from_zero=False,
        caption="Along the line of sight; above 0 it was estimated too far away.", band=0.75,
        values=_samples("longitudinal"),
    ),
)  # fmt: skip


def distribution_figures(campaign: Campaign) -> list[Figure]:
    """One for each quantity of which the file has any value."""
    found: list[Figure] = []
    for quantity in QUANTITIES:
        rows = [quantity.values(pool) for pool in campaign.pools]
        if any(len(row) for row in rows):
            found.append(_figure(quantity, campaign.pools, rows))
    return found


def _figure(quantity: Quantity, pools: Sequence[Pool], rows: Sequence[Array]) -> Figure:
    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        low, high, logarithmic = _limits(quantity, rows)
        if logarithmic:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)))
            axes.xaxis.set_major_formatter(lambda value, _: f"{value / 1e3:g}k" if value >= 1e4 else f"{value:g}")
            axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xlim(low, high)
        for row, values in enumerate(rows):
            axes.axhline(row, color=palette.rule, lw=0.8)
            if len(values):
                _row(axes, palette, row, values, logarithmic=logarithmic)
            axes.text(1.015, row, _said(quantity, values), transform=axes.get_yaxis_transform(), va="center")
        head = "median" if quantity.band is None else "5 … 95 %"
        axes.text(1.015, -0.85, head, transform=axes.get_yaxis_transform(), va="center", color=palette.soft)
        for limit in () if quantity.band is None else (-quantity.band, quantity.band):
            axes.axvline(limit, color=palette.soft, lw=0.9, ls=(0, (3, 3)))
        axes.set_yticks(range(len(rows)), [plain(pool.label) for pool in pools])
        axes.tick_params(axis="y", length=0, labelcolor=palette.ink)
        axes.set_ylim(len(rows) - 0.7, -1.05)
        axes.grid(visible=False, axis="y")
        axes.spines["left"].set_visible(False)
        axes.set_xlabel(f"{quantity.title[0].lower()}{quantity.title[1:]}, {quantity.unit}")

    caption = quantity.caption if quantity.band is None else f"{quantity.caption} Dashed: ± {quantity.band:g} m."
    return Figure(
        name=quantity.name,
        title=quantity.title,
        caption=caption,
        size_in=(HALF_IN, 1.0 + (0.46 if len(rows) <= 6 else 0.34) * len(rows)),
        draw=draw,
        tables={quantity.name: _table(quantity, pools, rows)},
    )


def _table(quantity: Quantity, pools: Sequence[Pool], rows: Sequence[Array]) -> dict[str, Any]:
    places = np.array([np.percentile(row, PLACES) if len(row) else np.full(len(PLACES), np.nan) for row in rows])
    return {
        "cell": np.array([pool.number for pool in pools]),
        "unit": np.array([quantity.unit] * len(rows)),
        "values": np.array([len(row) for row in rows]),
        **{f"p{place:.0f}": places[:, k] for k, place in enumerate(PLACES)},
    }


def _limits(quantity: Quantity, rows: Sequence[Array]) -> tuple[float, float, bool]:
    """The axis' ends, and whether it is by powers of ten. Of many values the rarest may lie beyond it."""
    low, high = np.inf, -np.inf
    for values in rows:
        if len(values):
            rare = 5.0 if quantity.band else 0.4 if len(values) >= FEW else 0.0
            least, most = np.percentile(values, [rare, 100.0 - rare])
            low, high = min(low, float(least)), max(high, float(most))
    if quantity.band:
        reach = float(np.clip(1.2 * max(abs(low), abs(high)), 1.6 * quantity.band, 4.0 * quantity.band))
        return -reach, reach, False
    if quantity.logarithmic and low > 0.0 and high > LOG_FROM * low:
        return low / 1.2, 1.2 * high, True
    if quantity.from_zero:
        low = min(low, 0.0)
    room = 0.04 * max(high - low, 0.05 * abs(high), 1e-3)
    return low - room if low < 0.0 or not quantity.from_zero else low, high + room, False


def _row(axes: Axes, palette: Palette, row: int, values: Array, *, logarithmic: bool) -> None:
    """A cell's values. Upwards is towards lower rows."""
    low, high = axes.get_xlim()
    edges = np.geomspace(low, high, BINS + 1) if logarithmic else np.linspace(low, high, BINS + 1)
    counts = np.histogram(values, edges)[0].astype(float)
    middles = np.sqrt(edges[:-1] * edges[1:]) if logarithmic else (edges[:-1] + edges[1:]) / 2
    if len(values) < FEW:
        _dots(axes, palette, row, middles, counts)
    else:
        away = np.arange(-5, 6)
        smooth = np.convolve(counts, np.exp(-0.5 * (away / SMOOTH_BINS) ** 2), mode="same")
        top = row - TALL * smooth / max(float(smooth.max()), 1e-9)
        axes.fill_between(middles, np.full(BINS, row), top, color=palette.vehicle, alpha=0.3, lw=0)
    p5, p25, p50, p75, p95 = np.clip(np.percentile(values, PLACES), low, high)
    axes.plot([p5, p95], [row, row], color=palette.vehicle, lw=1.4, solid_capstyle="butt")
    axes.plot([p25, p75], [row, row], color=palette.vehicle, lw=4.2, solid_capstyle="butt")
    axes.plot(p50, row, "o", mfc=palette.paper, mec=palette.vehicle, mew=1.5, ms=5.5, clip_on=False)


def _dots(axes: Axes, palette: Palette, row: int, middles: Array, counts: Array) -> None:
    """A dot for each value, those at the same place on top of each other: two bins are as wide as a dot."""
    stacks = counts.reshape(-1, 2).sum(axis=1).astype(int)
    step = min(0.13, (TALL - 0.2) / max(int(stacks.max(initial=1)), 1))
    x = np.repeat(middles.reshape(-1, 2)[:, 0], stacks)
    levels: Array = np.concatenate([np.arange(int(n), dtype=np.float64) for n in stacks]) if len(x) else np.zeros(0)
    axes.plot(x, row - 0.22 - step * levels, "o", color=palette.vehicle, mec="none", alpha=0.6, ms=3.4)


def _said(quantity: Quantity, values: Array) -> str:
    if not len(values):
        return "–"
    if quantity.band is not None:
        p5, p95 = np.percentile(values, [5.0, 95.0])
        return f"{number(float(p5))} … {number(float(p95))}"
    median = float(np.median(values))
    return number(median, 0 if abs(median) >= 100.0 else 1 if abs(median) >= 10.0 else 2)
