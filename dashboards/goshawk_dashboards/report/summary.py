"""A flight in figures and words: how it ended, what went wrong, how it flew. None: the log does not tell."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.charts.clearance import Clearance
from goshawk_dashboards.charts.errors import TargetErrors
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.latency import Latencies
from goshawk_dashboards.state.views import Array, HealthView

PATH_HZ = 20.0
"""At this rate a path's length is that of the flight, not of the estimate's noise."""
ON_TASK = ("tracking", "lost", "search", "navigation", "hold")
LANDED = ("landed", "on the ground")
GOOD_OUTCOMES = ("landed", "success", "ended: tracking", "ended: navigation", "ended: hold")
"""A simulated trial ends in the air, on its task, with a verdict or without."""


@dataclass(frozen=True, kw_only=True)
class Card:
    """What a list of flights shows of one; quick to have."""

    path: Path
    size_bytes: int
    wall_time: str | None
    """When it began, RFC 3339; None for a simulated flight, which has no date."""
    vehicle: str
    profile: str
    task: str | None
    policy_sha256: str | None
    version: str
    git_revision: str | None
    duration_s: float
    outcome: str
    """"landed", "collided", "handed back", "cut off", "damaged", or the phase in which the log ended."""
    phases_s: dict[str, float]
    """Phase → seconds in it."""
    faults: tuple[str, ...]
    """What went wrong, one line each, with how often."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """A distribution."""

    p5: float
    p50: float
    p95: float

    @staticmethod
    def of(values: Array) -> Spread | None:
        """None if there is none."""
        if len(values) == 0:
            return None
        p5, p50, p95 = np.percentile(values, [5, 50, 95]).tolist()
        return Spread(p5=p5, p50=p50, p95=p95)


@dataclass(frozen=True, kw_only=True)
class Figures:
    """How it flew; speeds while it was on its task, if it ever was."""

    path_m: float
    mean_speed_mps: float | None
    max_speed_mps: float | None
    max_acceleration_mps2: float | None
    """Of the commanded attitude and thrust."""
    mean_disturbance_mps2: float | None
    max_disturbance_mps2: float | None
    in_sight_fraction: float | None
    """Of the time on a tracking task: the target was seen within the last half second."""
    nearest_seen_m: float | None
    """From the vehicle's middle, by depth."""
    true_clearance_m: float | None
    """From the vehicle's hull, by the simulator, while it was on its task."""
    collisions: int | None
    target_lateral_m: Spread | None
    target_longitudinal_m: Spread | None
    frame_to_plan_ms: Spread | None
    planner_hz: float | None
    controller_hz: float | None


def card(flight: Flight) -> Card:
    """The short view of a flight."""
    header = flight.header
    phases: dict[str, float] = {}
    for phase in flight.phases:
        phases[phase.name] = phases.get(phase.name, 0.0) + phase.duration_s
    return Card(
        path=flight.path,
        size_bytes=flight.path.stat().st_size,
        wall_time=header.wall_time or None,
        vehicle=header.vehicle,
        profile=header.profile,
        task=_task(header.policy_contract_json),
        policy_sha256=header.policy_sha256 or None,
        version=header.version,
        git_revision=header.git_revision or None,
        duration_s=flight.duration_s,
        outcome=_outcome(flight),
        phases_s=phases,
        faults=_faults(flight),
    )


def _task(contract_json: str) -> str | None:
    try:
        task = json.loads(contract_json).get("task")
    except (json.JSONDecodeError, AttributeError, RecursionError):
        return None
    return task if isinstance(task, str) else None


def _outcome(flight: Flight) -> str:
    names = [phase.name for phase in flight.phases]
    verdict = next((e.text for e in flight.events if e.kind == "trial"), None)
    if verdict is not None:
        return verdict
    if _collisions(flight):
        return "collided"
    if "fault" in names:
        return "handed back"
    if not flight.closed:
        return "damaged" if flight.missing else "cut off"
    if not names:
        return "no controller step"
    flown = any(name not in LANDED for name in names)
    return ("landed" if flown else "never flew") if names[-1] in LANDED else f"ended: {names[-1]}"


def _collisions(flight: Flight) -> int | None:
    """During the log; None without the simulator's truth."""
    truth = flight.columns("sim_truth", ["collisions"])
    if len(truth) == 0:
        return None
    counts = truth["collisions"]
    return int(counts.max() - counts[0])


def _faults(flight: Flight) -> tuple[str, ...]:
    """Warnings and errors that it told, faults of its health, and rungs of the ladder, most frequent first."""
    found: Counter[str] = Counter()
    for event in flight.events:
        if event.severity in (pb.SEVERITY_WARNING, pb.SEVERITY_ERROR):
            found[event.text] += 1
    active: set[str] = set()
    for health in healths(flight):
        found.update(set(health.faults) - active)
        active = set(health.faults)
    for fallback in flight.fallbacks:
        found[f"fallback: {fallback.name}"] += 1
    return tuple(text if n == 1 else f"{text} ({n} times)" for text, n in found.most_common())


def healths(flight: Flight) -> Iterator[HealthView]:
    """Every heartbeat."""
    found = (flight.health_at(float(t)) for t in flight.times_s("health"))
    return (h for h in found if h is not None)


def figures(flight: Flight, seen: Clearance | None, errors: TargetErrors | None, latencies: Latencies) -> Figures:
    """The long view of a flight."""
    control = flight.columns(
        "control", ["pos_world", "vel_world", "acc_att_world", "acc_disturbance_world", "thrust_n"]
    )
    placed = flight.columns("control", ["pos_world"], max_hz=PATH_HZ)["pos_world"]
    placed = placed[np.isfinite(placed).all(axis=1)]
    task_M = on_task(flight, control.times_s)
    speed = np.linalg.norm(control["vel_world"][task_M], axis=1)
    pushing_M = task_M & (control["thrust_n"] > 0.0)
    acceleration = np.linalg.norm(control["acc_att_world"][pushing_M], axis=1)
    push = np.linalg.norm(control["acc_disturbance_world"][task_M], axis=1)
    truth = flight.columns("sim_truth", ["clearance_m"])
    clearance = truth["clearance_m"][on_task(flight, truth.times_s)]
    return Figures(
        path_m=float(np.linalg.norm(np.diff(placed, axis=0), axis=1).sum()),
        mean_speed_mps=_of(np.mean, speed),
        max_speed_mps=_of(np.max, speed),
        max_acceleration_mps2=_of(np.max, acceleration),
        mean_disturbance_mps2=_of(np.mean, push),
        max_disturbance_mps2=_of(np.max, push),
        in_sight_fraction=_in_sight(flight),
        nearest_seen_m=None if seen is None else seen.least_m,
        true_clearance_m=_of(np.min, clearance),
        collisions=_collisions(flight),
        target_lateral_m=None if errors is None else Spread.of(errors.lateral_m_M),
        target_longitudinal_m=None if errors is None else Spread.of(errors.longitudinal_m_M),
        frame_to_plan_ms=Spread.of(latencies.frame_to_plan_ms),
        planner_hz=_rate(flight.times_s("plan")),
        controller_hz=_rate(flight.times_s("control")),
    )


def on_task(flight: Flight, times_s_M: Array) -> np.ndarray:
    """Which instants lie in a phase of the flight's task."""
    inside_M = np.zeros(len(times_s_M), dtype=bool)
    for phase in flight.phases:
        if phase.name in ON_TASK:
            inside_M |= (times_s_M >= phase.start_s) & (times_s_M < phase.end_s)
    return inside_M


def _in_sight(flight: Flight) -> float | None:
    total = {
        name: sum(p.duration_s for p in flight.phases if p.name == name) for name in ("tracking", "lost", "search")
    }
    return total["tracking"] / sum(total.values()) if sum(total.values()) > 0.0 else None


def _of(measure: Callable[[Array], Any], values: Array) -> float | None:
    values = values[np.isfinite(values)]
    return float(measure(values)) if len(values) else None


def _rate(times_s: Array) -> float | None:
    """The median's: gaps do not count."""
    return float(1.0 / np.median(np.diff(times_s))) if len(times_s) > 1 else None
