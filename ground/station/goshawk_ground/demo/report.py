"""What the demo says of a flight: a table, the last words of what failed, and a file."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console

from goshawk_ground.demo.children import Child
from goshawk_ground.demo.director import STOPPED
from goshawk_ground.demo.flight_record import Summary


def write(summary: Summary, seed: int, file: Path) -> None:
    """The summary as JSON. Raises OSError."""
    facts = {"seed": seed, **dataclasses.asdict(summary)}
    file.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")


def show(summary: Summary, children: list[Child], console: Console) -> None:
    """The table, and of a flight that failed by itself the processes' last words."""
    for name, value in _rows(summary):
        console.print(f"{name:<15} {value}", markup=False, soft_wrap=True)
    if summary.succeeded or STOPPED in summary.problems:
        return
    for child in children:
        console.print(f"--- {child.name}: the end of {child.output}", style="bold", markup=False)
        console.print(child.tail(), markup=False)


def _rows(s: Summary) -> Iterator[tuple[str, str]]:
    yield "flight", "succeeded" if s.succeeded else "failed: " + "; ".join(s.problems)
    navigated = s.goal_distance_end_m is not None
    if navigated:
        yield "navigated", f"{s.tracked_s:.1f} s, the vehicle flew {s.vehicle_path_m:.1f} m"
    else:
        ran = f"the target ran {s.target_path_m:.1f} m, the vehicle {s.vehicle_path_m:.1f} m"
        yield "tracked", f"{s.tracked_s:.1f} s, {ran}"
    yield "speed", f"mean {_number(s.mean_speed_mps, 'm/s')}, max {_number(s.max_speed_mps, 'm/s')}"
    yield "clearance", f"min {_number(s.min_clearance_m, 'm', 2)}, collisions {s.collisions}"
    if navigated:
        yield "goal", f"{_number(s.goal_distance_end_m, 'm')} away at the end"
    else:
        seen = "-" if s.in_view_fraction is None else f"{100 * s.in_view_fraction:.0f} % of the time"
        yield "target in view", seen
        median, most = _number(s.target_distance_median_m, "m"), _number(s.target_distance_max_m, "m")
        end = _number(s.target_distance_end_m, "m")
        yield "distance to it", f"median {median}, max {most}, at the end {end}"
    yield "rates", f"planner {_number(s.planner_hz, 'Hz', 0)}, controller {_number(s.controller_hz, 'Hz', 0)}"
    yield "log", s.log_path or "-"


def _number(value: float | None, unit: str, digits: int = 1) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}"
