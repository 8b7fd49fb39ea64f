"""The paper's figures B to F in its own axes, a colour and a marker for each pilot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure as Canvas
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

from goshawk_dashboards.report.campaign.data import FlightRow
from goshawk_dashboards.report.canvas import Figure, Palette, Table, plain
from goshawk_dashboards.report.comparison.data import Comparison, Pair, Side
from goshawk_dashboards.report.comparison.latency import TASKS, latency_figure, measured
from goshawk_dashboards.state.views import Array

PILOTS = {"learned": ("vehicle", "o"), "classical": ("target", "s")}
"""Each with its colour of the palette and its marker."""
ENDINGS: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "success": ("success", ("success",)),
    "planning failed": ("collision", ("collision", "timeout", "slow")),
    "target missed": ("lost", ("lost", "out-of-view", "behind")),
    "too close": ("too_close", ("too-close",)),
}
SQUARE_M = 0.5
VIEW_DEG = 90.0
"""Of the camera, as wide as the paper's."""
FAST_MPS = 7.0
"""The paper's other speed of the target's heat map, beside the lowest."""

Spread = Sequence[float]
"""Low, middle and high; or 5, 25, 50, 75 and 95 % of the flights."""


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What is drawn against speed."""

    name: str
    title: str
    caption: str
    label: str
    places: tuple[str, ...]
    """What the spread's numbers are, as columns."""
    spread: Callable[[Side], Spread | None]
    logarithmic: bool = False
    by_cruise: bool = False
    """Against the cruise speed that was flown, instead of the asked speed."""


def _success(side: Side) -> Spread:
    low, high = side.cell.success_interval
    return 100.0 * low, side.successes, 100.0 * high


def _time(side: Side) -> Spread | None:
    times = side.cell.time_to_goal_s
    found = [] if times is None else [v for v in (times.p5, times.p50, times.p95) if v is not None]
    return found if len(found) == 3 else None


def _of_flights(read: Callable[[FlightRow], float | None]) -> Callable[[Side], Spread | None]:
    def spread(side: Side) -> Spread | None:
        values = [value for value in map(read, side.cell.flights) if value is not None]
        return np.percentile(values, FIVE).tolist() if values else None

    return spread


FIVE = (5.0, 25.0, 50.0, 75.0, 95.0)
_PLACES = tuple(f"p{place:.0f}" for place in FIVE)
BARS = "Thin bar: 5 to 95 % of the flights. Thick bar: 25 to 75 %. Marker: median."
QUANTITIES = (
    Quantity(
        name="success", title="B. Success rate", label="successes, %", places=("low", "share", "high"),
        caption="Strict successes, with the 95 % interval of the rate (Wilson).", spread=_success,
    ),
    Quantity(
        name="smoothness", title="E. Smoothness, ∫ jerk²", label="∫ jerk², m²/s⁵", places=_PLACES, logarithmic=True,
        caption=f"Less is smoother. {BARS}",
        spread=_of_flights(lambda f: f.jerk_integral if f.jerk_integral > 0.0 else None),
    ),
    Quantity(
        name="clearance", title="F. Least clearance", label="least clearance, m", places=_PLACES,
        caption=f"From the hull to the nearest obstacle; at 0 it touched. {BARS}",
        spread=_of_flights(lambda f: None if f.clearance_m is None else max(f.clearance_m, 0.0)),
    ),
    Quantity(
        name="time", title="Time to goal", label="time to goal, s", places=("p5", "p50", "p95"), by_cruise=True,
        caption="Of the flights that reached it, against the speed that was flown. Bar: 5 to 95 %. Marker: median.",
        spread=_time,
    ),
)  # fmt: skip


def comparison_figures(comparison: Comparison) -> list[Figure]:
    """All that the campaigns allow: A, then the chase's B to F, then navigation's."""
    found = [latency_figure(rows)] if (rows := measured(comparison)) else []
    for task, what in TASKS.items():
        pairs = comparison.of(task)
        drawn = {q.name: _against_speed(q, task, what, pairs) for q in QUANTITIES if _any(q, pairs)}
        if task == "track" and pairs:
            aims = [heat for heat in [_target(pairs)] if heat is not None]
            found += [drawn.pop("success"), _failures(pairs), *aims]
        found += drawn.values()
    return found


def _any(quantity: Quantity, pairs: Sequence[Pair]) -> bool:
    return any(quantity.spread(side) is not None for pair in pairs for _, side in pair.sides)


def _against_speed(quantity: Quantity, task: str, what: str, pairs: Sequence[Pair]) -> Figure:
    """A tile for each campaign and place, as wide as it has speeds."""
    tiles: dict[tuple[int, str], list[Pair]] = {}
    for pair in pairs:
        tiles.setdefault((id(pair.campaign), pair.place), []).append(pair)

    def draw(canvas: Canvas, palette: Palette) -> None:
        widths = [len(own) + 1.0 for own in tiles.values()]
        row = canvas.subplots(1, len(tiles), squeeze=False, sharey=True, width_ratios=widths)[0]
        for axes, ((_, place), own) in zip(row, tiles.items(), strict=True):
            for number, name in enumerate(PILOTS):
                _pilot(axes, palette, quantity, own, name, 0.0 if quantity.by_cruise else 0.24 * (number - 0.5))
            axes.set_title(plain("\n".join(place.split(", "))), fontsize=8.5)
            axes.grid(visible=False, axis="x")
            if quantity.by_cruise:
                flown = [side.cell.cruise_speed_mps or 0.0 for pair in own for _, side in pair.sides]
                low, high = int(min(flown)), int(max(flown)) + 1
                axes.set_xticks(range(low, high + 1, max((high - low) // 4, 1)))
                axes.set_xlim(low - 0.3, high + 0.3)
            else:
                axes.set_xticks(range(len(own)), [f"{pair.learned.cell.speed_mps:g}" for pair in own])
                axes.set_xlim(-0.6, len(own) - 0.4)
        if quantity.logarithmic:
            row[0].set_yscale("log")
            row[0].yaxis.set_major_formatter(FuncFormatter(_short))
        elif quantity.name != "success":
            row[0].set_ylim(bottom=0.0)
        row[0].set_ylabel(quantity.label)
        canvas.supxlabel(_speed(quantity, task), fontsize=9, color=palette.soft)
        looks = ((name, getattr(palette, color), marker) for name, (color, marker) in PILOTS.items())
        key = [Line2D([], [], color=color, marker=marker, label=name) for name, color, marker in looks]
        canvas.legend(handles=key, loc="outside upper right", ncols=2)

    name = f"{task}_{quantity.name}"
    return Figure(
        name=name, title=f"{quantity.title}, {what}", caption=quantity.caption, size_in=(10.0, 3.5), draw=draw,
        tables={name: _columns(quantity, pairs)},
    )  # fmt: skip


def _short(value: float, _: object) -> str:
    return f"{value / 1e3:g}k" if value >= 1e4 else f"{value:g}"


def _speed(quantity: Quantity, task: str) -> str:
    if quantity.by_cruise:
        return "cruise speed, m/s"
    return "target's speed, m/s" if task == "track" else "asked speed, m/s"


def _pilot(axes: Axes, palette: Palette, quantity: Quantity, pairs: Sequence[Pair], name: str, aside: float) -> None:
    color, marker = getattr(palette, PILOTS[name][0]), PILOTS[name][1]
    points: list[tuple[float, float]] = []
    for slot, pair in enumerate(pairs):
        side = dict(pair.sides)[name]
        at = side.cell.cruise_speed_mps if quantity.by_cruise else slot + aside
        spread = quantity.spread(side)
        if spread is None or at is None:
            continue
        axes.plot([at, at], [spread[0], spread[-1]], color=color, lw=1.3, solid_capstyle="butt")
        if len(spread) == len(FIVE):
            axes.plot([at, at], [spread[1], spread[3]], color=color, lw=4.2, alpha=0.55, solid_capstyle="butt")
        points.append((at, spread[len(spread) // 2]))
    axes.plot(*np.array(points).reshape(-1, 2).T, color=color, marker=marker, mec=palette.paper, ms=5.5, lw=1.0)


def _columns(quantity: Quantity, pairs: Sequence[Pair]) -> Table:
    rows = [(pair, name, side, quantity.spread(side)) for pair in pairs for name, side in pair.sides]
    known = [(pair, name, side, spread) for pair, name, side, spread in rows if spread is not None]
    return {
        "campaign": np.array([pair.campaign.name for pair, *_ in known]),
        "place": np.array([pair.place for pair, *_ in known]),
        "pilot": np.array([name for _, name, *_ in known]),
        "speed_mps": np.array([side.cell.speed_mps for _, _, side, _ in known]),
        "cruise_speed_mps": np.array([side.cell.cruise_speed_mps for _, _, side, _ in known], dtype=object),
        **{place: np.array([spread[k] for *_, spread in known]) for k, place in enumerate(quantity.places)},
    }


def _failures(pairs: Sequence[Pair]) -> Figure:
    sides = {name: [dict(pair.sides)[name].cell for pair in pairs] for name in PILOTS}
    counts = {
        name: [sum(cell.count(outcome) for cell in cells for outcome in of) for _, of in ENDINGS.values()]
        for name, cells in sides.items()
    }
    shares = {name: 100.0 * np.array(own) / max(sum(own), 1) for name, own in counts.items()}

    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        left = np.zeros(len(PILOTS))
        for k, (words, (color, _)) in enumerate(ENDINGS.items()):
            own = np.array([shares[name][k] for name in PILOTS])
            alpha = 0.35 if words == "success" else 1.0
            axes.barh(range(len(PILOTS)), own, left=left, height=0.6, color=getattr(palette, color), alpha=alpha,
                      label=words)  # fmt: skip
            for place, share in enumerate(own):
                if share >= 5.0:
                    ink = palette.ink if words == "success" else palette.paper
                    axes.text(left[place] + share / 2, place, f"{share:.0f}", ha="center", va="center", color=ink)
            left += own
        axes.set_yticks(range(len(PILOTS)), list(PILOTS))
        axes.tick_params(axis="y", length=0, labelcolor=palette.ink)
        axes.set_ylim(len(PILOTS) - 0.4, -0.6)
        axes.set_xlim(0.0, 100.0)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("share of all tracking flights, %")
        canvas.legend(loc="outside upper right", ncols=len(ENDINGS))

    rows = [(name, k, words) for name in PILOTS for k, words in enumerate(ENDINGS)]
    table: Table = {
        "pilot": np.array([name for name, *_ in rows]),
        "ending": np.array([words for *_, words in rows]),
        "flights": np.array([counts[name][k] for name, k, _ in rows]),
        "share": np.array([shares[name][k] for name, k, _ in rows]),
    }
    said = (f"{words}: {', '.join(of).replace('-', ' ')}" for words, (_, of) in list(ENDINGS.items())[1:3])
    return Figure(
        name="track_failures", title="C. Failures, all tracking flights",
        caption=f"{'; '.join(said).capitalize()}.", size_in=(10.0, 1.9), draw=draw, tables={"track_failures": table},
    )  # fmt: skip


def _target(pairs: Sequence[Pair]) -> Figure | None:
    """A panel for each pilot and speed: the lowest, and the paper's other."""
    seen = [pair for pair in pairs if all(side.cell.target_plane for _, side in pair.sides)]
    speeds = sorted({pair.learned.cell.speed_mps for pair in seen})
    shown = [speed for speed in speeds if speed in (speeds[0], FAST_MPS)]
    if not shown:
        return None
    heats = {
        (name, speed): sum(_counts(dict(pair.sides)[name]) for pair in seen if pair.learned.cell.speed_mps == speed)
        for speed in shown
        for name in PILOTS
    }

    def draw(canvas: Canvas, palette: Palette) -> None:
        row = canvas.subplots(1, len(heats), squeeze=False, sharex=True, sharey=True)[0]
        for axes, ((name, speed), counts) in zip(row, heats.items(), strict=True):
            _heat(axes, palette, np.asarray(counts), getattr(palette, PILOTS[name][0]))
            axes.set_title(f"{name}, {speed:g} m/s")
            axes.set_xlabel("to the right, m")
        row[0].set_ylabel("forward, m")

    return Figure(
        name="track_target", title="D. Where the target was, from above",
        caption="In all frames that show it, in all campaigns of the speed; the stronger, the more often. The vehicle "
        f"is at 0, 0. Lines: the {VIEW_DEG:g}° of the camera. What was farther off counts at the border.",
        size_in=(10.0, 0.8 + 7.0 / len(heats)), draw=draw,
        tables={"track_target": _squares({key: np.asarray(counts) for key, counts in heats.items()})},
    )  # fmt: skip


def _counts(side: Side) -> Array:
    rows = side.cell.target_plane.rows if side.cell.target_plane else ()
    return np.array([row.split() for row in rows], dtype=float)


def _places(counts: Array) -> Iterator[tuple[float, float, float]]:
    """Right and forward of each square's nearer left corner, m, and its count; of those that are not empty."""
    for forward, across in zip(*np.nonzero(counts), strict=True):
        yield SQUARE_M * (across - counts.shape[1] / 2), SQUARE_M * forward, float(counts[forward, across])


def _heat(axes: Axes, palette: Palette, counts: Array, color: str) -> None:
    corners = SQUARE_M * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    squares = [corners + (right, forward) for right, forward, _ in _places(counts)]
    # By its root, so that rare places show.
    alpha = [np.sqrt(count / counts.max()) for *_, count in _places(counts)]
    axes.add_collection(PolyCollection(squares, facecolors=color, alpha=alpha, lw=0))
    reach_m = SQUARE_M * counts.shape[0]
    edge_m = reach_m * np.sin(np.radians(VIEW_DEG / 2))
    arc = np.radians(np.linspace(-VIEW_DEG / 2, VIEW_DEG / 2, 31))
    right, forward = reach_m * np.sin(arc), reach_m * np.cos(arc)
    axes.plot([0.0, *right, 0.0], [0.0, *forward, 0.0], color=palette.attitude, lw=1.0)
    axes.set_xlim(-max(edge_m, reach_m / 2), max(edge_m, reach_m / 2))
    axes.set_ylim(-0.5, reach_m + 0.2)
    axes.set_xticks([-8, -4, 0, 4, 8])
    axes.set_yticks([0, 4, 8, 12])
    axes.set_aspect("equal")


def _squares(heats: Mapping[tuple[str, float], Array]) -> Table:
    rows = [(name, speed, *place) for (name, speed), counts in heats.items() for place in _places(counts)]
    names = ("pilot", "speed_mps", "right_m", "forward_m", "count")
    return {column: np.array([row[k] for row in rows]) for k, column in enumerate(names)}
