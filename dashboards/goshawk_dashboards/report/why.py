"""Why a flight ended as it did: what the vehicle told, and what the log measures, in sentences. Pure."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.phases import Phase
from goshawk_dashboards.state.views import Array, EventView

LAST_S = 5.0
"""Before the end: what may have to do with it."""
NEAR_M = 1.0
UNDER_WAY = frozenset({"Takeoff", "Track", "Navigate", "Search", "Hold"})
"""The modes of a flight until it is ended, as the vehicle tells them."""
GROUND = frozenset({"Idle", "Ready", "Landed"})


def why(flight: Flight) -> list[str]:
    """The longest chain of reasons that the log holds, the end first."""
    return [*_end(flight), *_collision(flight), *_sight(flight), *_apart(flight), *_before_the_end(flight)]


def _end(flight: Flight) -> Iterator[str]:
    """What ended it, or the mode that it is in at the end of the log."""
    told = [e for e in flight.events if e.kind == "mode" and " → " in e.text]
    if told:
        for event in _ending(told):
            at_s = (event.stamp_ns - flight.start_ns) * 1e-9
            before, after = _modes(event)
            ended = before in UNDER_WAY and after not in UNDER_WAY
            came = "What ended the flight came" if ended else "Its last change of mode came"
            yield f"{came} at {at_s:.2f} s. {event.text}."
    elif flight.phases:
        yield f"It was in {flight.phases[-1].name} to the end, and told of no change of mode."
    if flight.missing:
        yield f"The log is damaged: {', '.join(flight.missing)} missing."
    elif not flight.closed:
        yield "The log was cut off, by a kill or a loss of power: what came after is not known."


def _ending(told: list[EventView]) -> list[EventView]:
    """The change of mode that ended the flight, and one that its landing took after it.

    Of a flight that goes on, or never began, the last change alone.
    """
    found: list[EventView] = []
    for event in reversed(told):
        before, after = _modes(event)
        # What comes after a flight says nothing of it: "Landed → Ready: all readiness checks hold".
        if before in UNDER_WAY or after not in GROUND:
            found.insert(0, event)
            if before != "Stopping":
                break
    return found or told[-1:]


def _modes(event: EventView) -> tuple[str, str]:
    """From and to, of "Track → Stopping: the operator's Stop"."""
    before, _, rest = event.text.partition(" → ")
    return before, rest.partition(":")[0]


def _collision(flight: Flight) -> Iterator[str]:
    truth = flight.columns("sim_truth", ["collisions", "clearance_m", "vel_world"])
    hits = np.flatnonzero(np.diff(truth["collisions"].astype(np.int64)) > 0) + 1
    if len(hits) == 0:
        return
    hit_s = float(truth.times_s[hits[0]])
    speed_mps = float(np.linalg.norm(truth["vel_world"][hits[0] - 1]))
    yield f"It touched something at {hit_s:.2f} s, flying {speed_mps:.1f} m/s."
    far = np.flatnonzero(truth["clearance_m"][: hits[0]] > NEAR_M)
    if len(far):
        yield f"For {hit_s - truth.times_s[far[-1]]:.1f} s before, it had been nearer than {NEAR_M:g} m to it."
    plan, control = flight.plan_at(hit_s - 0.02), flight.control_at(hit_s - 0.02)
    if plan is not None and plan.chosen is not None:
        eligible = sum(r in (pb.REJECTION_NONE, pb.REJECTION_COST) for r in plan.rejections)
        yield f"The planner then flew candidate {plan.chosen + 1}, of {eligible} that it held to be free."
    elif plan is not None:
        yield "The planner then held no candidate to be free."
    if control is not None and control.plan_age_s is not None:
        yield f"That plan's picture was {1e3 * control.plan_age_s:.0f} ms old."


def _sight(flight: Flight) -> Iterator[str]:
    unseen = [p for p in _joined(flight.phases) if p.name == "out of sight"]
    if not unseen:
        return
    longest = max(unseen, key=lambda p: p.duration_s)
    total_s = sum(p.duration_s for p in unseen)
    yield (
        f"The target was out of sight {_times(len(unseen))}, {total_s:.1f} s in all; "
        f"the longest was {longest.duration_s:.1f} s from {longest.start_s:.2f} s on."
    )


def _joined(phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
    """Lost and searched for, as one."""
    names = np.array(["out of sight" if p.name in ("lost", "search") else p.name for p in phases], dtype=object)
    starts_s = np.array([p.start_s for p in phases])
    runs = Phase.runs(np.append(starts_s, phases[-1].end_s), np.append(names, names[-1])) if len(phases) else ()
    # The mission passes through search on its way from the take-off.
    return tuple(p for p in runs if p.duration_s > 0.1)


def _apart(flight: Flight) -> Iterator[str]:
    truth = flight.columns("sim_truth", ["target_distance_m", "clearance_m", "target_visible"])
    flown = _within(truth.times_s, [p for p in flight.phases if p.name in ("tracking", "lost", "search", "navigation")])
    if not flown.any():
        return
    known = flown & np.isfinite(truth["clearance_m"])
    if known.any():
        clearance = np.where(known, truth["clearance_m"], np.inf)
        nearest = int(np.argmin(clearance))
        at_s = truth.times_s[nearest]
        yield f"On its task it came nearest to an obstacle at {at_s:.2f} s: {clearance[nearest]:.2f} m."
    measured = flown & np.isfinite(truth["target_distance_m"])
    if len(flight.times_s("target")) and measured.any():
        distance = truth["target_distance_m"][measured]
        yield _in_view(truth.times_s[flown], truth["target_visible"][flown].astype(bool))
        far_s = truth.times_s[measured][int(np.argmax(distance))]
        yield (
            f"The target was {distance.min():.1f} to {distance.max():.1f} m away, farthest at {far_s:.2f} s, and "
            f"{distance[-1]:.1f} m at the end."
        )


def _in_view(times_s: Array, visible: np.ndarray) -> str:
    share = f"The target was in the camera's view {100.0 * float(np.mean(visible)):.0f} % of that time"
    hidden = [p for p in Phase.runs(times_s, visible) if p.name == "False"]
    if not hidden:
        return f"{share}."
    longest = max(hidden, key=lambda p: p.duration_s)
    return f"{share}; the longest without was {longest.duration_s:.1f} s from {longest.start_s:.2f} s on."


def _before_the_end(flight: Flight) -> Iterator[str]:
    end_s = flight.duration_s
    bad = [e for e in flight.events if e.severity in (pb.SEVERITY_WARNING, pb.SEVERITY_ERROR) and e.kind != "trial"]
    for event in bad:
        at_s = (event.stamp_ns - flight.start_ns) * 1e-9
        if at_s > end_s - LAST_S:
            yield f"{end_s - at_s:.1f} s before the end it told: {event.text}."
    for fallback in flight.fallbacks:
        if fallback.end_s > end_s - LAST_S:
            from_s, for_s = fallback.start_s, fallback.duration_s
            yield f"From {from_s:.2f} s on the controller fell back for {for_s:.2f} s: {fallback.name}."
    doubt = flight.columns("control", ["odometry_doubt"])
    failed = np.flatnonzero(doubt["odometry_doubt"] >= 1.0)
    if len(failed):
        yield f"The odometry failed a check at {doubt.times_s[failed[0]]:.2f} s."


def _within(times_s: Array, phases: list[Phase]) -> np.ndarray:
    inside = np.zeros(len(times_s), dtype=bool)
    for phase in phases:
        inside |= (times_s >= phase.start_s) & (times_s < phase.end_s)
    return inside


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
