"""How long things took, by the log's own stamps and by the vehicle's heartbeats."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.state.views import Array, LatencyView


@dataclass(frozen=True, kw_only=True, eq=False)
class Latencies:
    """Each array has one value an occurrence, milliseconds."""

    frame_to_plan_ms: Array
    """From the middle of the exposure to the plan that the controller gets."""
    control_period_ms: Array
    """Between controller steps that were logged one after the other."""
    plan_age_ms: Array
    """Of the plan that is flown, at each controller step, since its exposure."""
    told: tuple[LatencyView, ...]
    """The vehicle's own sums at the last heartbeat."""


def latencies(flight: Flight) -> Latencies:
    """All of them; empty arrays where the log has none."""
    plan = flight.columns("plan", ["frame_ns", "ready_ns"])
    control = flight.columns("control", ["seq", "stamp_ns", "plan_age_s"])
    steps, periods_ns = np.diff(control["seq"].astype(np.int64)), np.diff(control["stamp_ns"].astype(np.int64))
    age_s = control["plan_age_s"]
    health = flight.health_at(flight.duration_s)
    return Latencies(
        frame_to_plan_ms=_ms(plan["ready_ns"].astype(np.int64) - plan["frame_ns"].astype(np.int64)),
        control_period_ms=_ms(periods_ns[steps == 1]),
        plan_age_ms=1e3 * age_s[np.isfinite(age_s)],
        told=health.latencies if health is not None else (),
    )


def _ms(span_ns: NDArray[np.int64]) -> Array:
    return span_ns.astype(np.float64) * 1e-6
