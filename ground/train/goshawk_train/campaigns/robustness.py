"""What the policies bear: campaigns with more and more of one trouble, and the figure of their successes."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from goshawk_dashboards.report.canvas import Figure, Palette, png
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas

from goshawk_train.campaigns.flights import FlightsError, Row, read_rows, refuse_unknown, whole

TASKS = ("track", "navigate")


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """One trouble, at several values."""

    name: str
    label: str
    values: list[float]
    option: str = ""
    """Of `goshawk-sim fly`, to be followed by the value."""
    scale: dict[str, float] = field(default_factory=dict[str, float])
    """Numbers of the sensors' file, to be multiplied by the value."""

    def options(self, value: float) -> list[str]:
        """What `goshawk-sim fly` is called with for a value."""
        out = [self.option, f"{value:g}"] if self.option else []
        for key, unit in self.scale.items():
            out += ["--set", f"{key}={value * unit:g}"]
        return out

    def row(self, task: str, speed_mps: float, value: float) -> Row:
        """The campaign at one value; worlds are forests of a tree every 4 m."""
        name = f"{self.name} {task} {value:g}"
        return Row(name=name, task=task, speeds=[speed_mps], spacings=[4], options=self.options(value))


Point = tuple[Sweep, str, float, dict[str, Any]]
"""A sweep, a task, a value, and the cell that was flown there."""


def load(path: Path) -> tuple[int, int, dict[str, float], list[Sweep]]:
    """Trials a campaign, seed, speed of each task, sweeps; raises `FlightsError`."""
    try:
        table = tomllib.loads(path.read_text())
        refuse_unknown(table, {"trials", "seed", "speeds_mps", "sweep"})
        speeds_mps = {task: float(table["speeds_mps"][task]) for task in TASKS}
        sweeps = [Sweep(**sweep) for sweep in table["sweep"]]
        read_rows([vars(sweep.row(task, 1.0, value)) for sweep in sweeps for task in TASKS for value in sweep.values])
        return whole(table, "trials"), whole(table, "seed", 0), speeds_mps, sweeps
    except (OSError, tomllib.TOMLDecodeError, AttributeError, KeyError, TypeError, ValueError) as error:
        raise FlightsError(f"{path} lists no sweeps: {error}") from error


def draw(points: Sequence[Point], out: Path) -> None:
    """The picture as PNG."""
    out.write_bytes(png(figure(points)))


def figure(points: Sequence[Point]) -> Figure:
    """Over each trouble, one column a sweep: successes with their 95 % interval, and how near the vehicle came to an
    obstacle where any flight succeeded."""
    sweeps = list({sweep.name: sweep for sweep, *_ in points}.values())

    def draw(canvas: Canvas, palette: Palette) -> None:
        rows = canvas.subplots(2, len(sweeps), sharex="col", sharey="row", squeeze=False)
        for upper, lower, sweep in zip(*rows, sweeps, strict=True):
            for task, color, marker in zip(TASKS, (palette.target, palette.vehicle), "os", strict=True):
                own = [(value, cell) for s, t, value, cell in points if (s.name, t) == (sweep.name, task)]
                if own:
                    _curves(upper, lower, own, task, {"color": color, "marker": marker, "markersize": 4})
            upper.set_ylim(0, 102)
            lower.set_xlabel(sweep.label)
        rows[1][0].set_ylim(bottom=0)
        rows[1][0].set_ylabel("closest approach, m\n(median; dotted: 5 %)")
        rows[0][0].set_ylabel("successes, % (band: 95 %)")
        rows[0][0].legend(loc="lower left")

    title, caption = "What the policies bear", "Successes and closest approach against one trouble at a time."
    size_in = (2.8 * len(sweeps), 4.6)
    return Figure(name="robustness", title=title, caption=caption, size_in=size_in, draw=draw, tables={})


def _curves(upper: Axes, lower: Axes, own: list[tuple[float, dict[str, Any]]], task: str, look: dict[str, Any]) -> None:
    """A task's successes and closest approach over a sweep's values."""
    values = [value for value, _ in own]
    share = [100 * cell["successes"] / cell["trials"] for _, cell in own]
    low, high = ([100 * cell["success_interval"][k] for _, cell in own] for k in (0, 1))
    upper.fill_between(values, low, high, color=look["color"], alpha=0.15, linewidth=0)
    upper.plot(values, share, label=f"{task}, {own[0][1]['speed_mps']:g} m/s", **look)
    flown = [(value, cell["clearance_m"]) for value, cell in own if cell["successes"]]
    for percentile, line in (("p50", "-"), ("p5", ":")):
        clearance = [clearance[percentile] for _, clearance in flown]
        lower.plot([value for value, _ in flown], clearance, line, **look)
