"""What each module of the pilots costs here, beside what the paper's text says of its own trackers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape

import numpy as np
from matplotlib.figure import Figure as Canvas

from goshawk_dashboards.report.campaign.data import Cost
from goshawk_dashboards.report.campaign.tables import NONE, number
from goshawk_dashboards.report.canvas import Figure, Palette, Table
from goshawk_dashboards.report.comparison.data import Comparison
from goshawk_dashboards.report.shell import table

MODULES = {"perception": "vehicle", "mapping": "desired", "planning": "lost", "control": "up", "not split": "soft"}
"""Each with its colour of the palette."""
TOTAL = "total"
TASKS = {"track": "tracking", "navigate": "navigation"}
PAPERS = "i7-9700, RTX 3060"


@dataclass(frozen=True, kw_only=True)
class Latency:
    """Of one pilot, ms."""

    name: str
    mean: Mapping[str, float]
    """Of each module that is known, and the total."""
    p99: Mapping[str, float]


PAPER = (
    Latency(name=f"Vis. Tracker, {PAPERS}", mean={"mapping": 50.0, "not split": 16.7, TOTAL: 66.7}, p99={}),
    Latency(name=f"YOPOv2-Tracker, {PAPERS}", mean={"perception": 2.0, "not split": 1.0, TOTAL: 3.0}, p99={}),
    Latency(name="YOPOv2-Tracker, Orin NX", mean={"not split": 8.2, TOTAL: 8.2}, p99={}),
)
NOTE = (
    "Measured here: processor time of one thread for a camera's frame, without a GPU. A mean is over all plans of the "
    "campaigns; a 99 % is the highest of any campaign. The paper's are published: its Vis. Tracker spends nearly 50 ms "
    "on mapping and ESDF; of its own 3 ms, 2 ms are the network's, with TensorRT, and 1 ms is post-processing; 8.2 ms "
    "is from perception to action. What is left of a total is not split. Its text gives no other module's time, no "
    "99 %, and no number for Elas. Tracker."
)


def measured(comparison: Comparison) -> list[Latency]:
    """Of each task and pilot of which any campaign says it."""
    found: list[Latency] = []
    for task, what in TASKS.items():
        for place, name in enumerate(("learned", "classical")):
            sides = [pair.sides[place][1] for pair in comparison.once() if pair.learned.cell.task == task]
            computes = [side.compute for side in sides if side.compute is not None]
            if not computes:
                continue
            plans = np.array([max(compute.plans, 1) for compute in computes])
            costs: dict[str, list[Cost]] = {
                module: [getattr(compute, f"{module}_ms") for compute in computes]
                for module in (*list(MODULES)[:4], TOTAL)
            }
            found.append(
                Latency(
                    name=f"{name}, {what}",
                    mean={m: float(np.average([c.mean for c in of], weights=plans)) for m, of in costs.items()},
                    p99={m: max(c.p99 for c in of) for m, of in costs.items()},
                )
            )
    return found


def latency_table(rows: list[Latency]) -> str:
    """As HTML: mean / 99 % of each module."""

    def line(row: Latency, where: str) -> Iterator[str]:
        yield f"<td>{escape(row.name)}</td><td>{where}</td>"
        for module in (*MODULES, TOTAL):
            mean, p99 = row.mean.get(module), row.p99.get(module)
            digits = 3 if module == "control" else 2
            text = NONE if mean is None else f"{mean:g}"
            if p99 is not None:
                text = f"{number(mean, digits)} / {number(p99, digits)}"
            yield f"<td class='number'>{text}</td>"

    heads = ["", "", *(f"{module}<small>mean / 99 %, ms</small>" for module in (*MODULES, TOTAL))]
    lines = [*(line(row, "here") for row in rows), *(line(row, "the paper") for row in PAPER)]
    return table(heads, lines, "cells")


def latency_figure(rows: list[Latency]) -> Figure:
    """Stacked bars: ours, and on an axis of their own the paper's."""
    parts = (("processor time here, ms a plan", rows), ("published by the paper, ms", list(PAPER)))

    def draw(canvas: Canvas, palette: Palette) -> None:
        for axes, (label, bars) in zip(canvas.subplots(1, 2, width_ratios=(1.0, 1.0)), parts, strict=True):
            left = np.zeros(len(bars))
            for module, color in MODULES.items():
                ms = np.array([bar.mean.get(module, 0.0) for bar in bars])
                axes.barh(range(len(bars)), ms, left=left, height=0.6, color=getattr(palette, color), label=module)
                left += ms
            for place, total in enumerate(left):
                axes.annotate(f"{total:.3g}", (total, place), (4, 0), textcoords="offset points", va="center")
            axes.set_yticks(range(len(bars)), [bar.name.replace(", ", "\n", 1) for bar in bars])
            axes.tick_params(axis="y", length=0, labelcolor=palette.ink)
            axes.set_xlim(0.0, 1.12 * max(left, default=1.0))
            axes.set_ylim(len(bars) - 0.5, -0.5)
            axes.grid(visible=False, axis="y")
            axes.set_xlabel(label)
        handles, names = canvas.axes[0].get_legend_handles_labels()
        canvas.legend(handles, names, loc="outside upper right", ncols=len(MODULES))

    return Figure(
        name="latency",
        title="A. Latency by module",
        caption="The two axes differ, and so do the machines.",
        size_in=(10.0, 3.2),
        draw=draw,
        tables={"latency": _columns([*rows, *PAPER])},
    )


def _columns(rows: list[Latency]) -> Table:
    cells = [(row, module) for row in rows for module in (*MODULES, TOTAL) if module in row.mean]
    return {
        "pilot": np.array([row.name for row, _ in cells]),
        "module": np.array([module for _, module in cells]),
        "mean_ms": np.array([row.mean[module] for row, module in cells]),
        "p99_ms": np.array([row.p99.get(module) for row, module in cells], dtype=object),
    }
