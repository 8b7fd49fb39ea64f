"""What a recorded flight looked like at one instant, as the live view's snapshot, and what is worth jumping to. Pure.

Shape suffixes: M records, N trail points, 3 a vector.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.state import views as view
from goshawk_dashboards.state.snapshot import SAMPLE_STALE_S, Snapshot
from goshawk_dashboards.state.views import Array

CHANNELS = ("control", "plan", "map", "target", "health", "preview", "event", "sim_truth")
ESTIMATES = ("control", "target", "sim_truth")
SHORT_S = 0.1
"""A shorter phase is no place to jump to: the mission passes through search on its way to track."""
TRAIL_S = 30.0
TRAIL_HZ = 10.0


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A moment worth jumping to."""

    time_s: float
    severity: pb.Severity
    text: str


def snapshot_at(flight: Flight, time_s: float) -> Snapshot:
    """All that the log knows at a time, with each channel's age as the live view counts it."""
    return replace(
        estimates_at(flight, time_s, CHANNELS),
        plan=flight.plan_at(time_s),
        remembered=flight.remembered_at(time_s),
        health=flight.health_at(time_s),
        preview=_preview_at(flight, time_s),
        world=flight.world,
    )


def estimates_at(flight: Flight, time_s: float, channels: Sequence[str] = ESTIMATES) -> Snapshot:
    """The same of controller, target filter and truth alone, all that a track of the estimates reads."""
    return Snapshot(
        now_s=time_s,
        vehicle=flight.header.vehicle or flight.path.stem,
        endpoint=flight.path.name,
        linked=True,
        alive=True,
        control=flight.control_at(time_s),
        target=flight.target_at(time_s),
        truth=flight.truth_at(time_s),
        channels=tuple(_channel(flight, name, time_s) for name in channels),
    )


def _preview_at(flight: Flight, time_s: float) -> view.PreviewView | None:
    """Of a flight that the ground recorded, which has no frames, what the link brought."""
    if not flight.count("rgbd"):
        return flight.preview_at(time_s)
    frame = frame_at(flight, time_s)
    return None if frame is None else frame.preview


def _channel(flight: Flight, name: str, time_s: float) -> view.ChannelView:
    index = flight.index_at(name, time_s)
    age_s = None if index is None else max(0.0, time_s - flight.time_s(name, index))
    count = 0 if index is None else index + 1
    return view.ChannelView(
        name=name, count=count, age_s=age_s, rate_hz=0.0, bytes_per_s=0.0, loss_fraction=None, malformed=0
    )


def frame_at(flight: Flight, time_s: float) -> FrameView | None:
    """The picture that the current plan was made of; the newest one where there is no plan."""
    plan = flight.plan_at(time_s)
    if plan is None:
        return flight.frame_at(time_s)
    taken_s = (plan.frame_ns - flight.start_ns) * 1e-9
    # An older plan says nothing of the picture beside it.
    return flight.frame_at(taken_s if time_s - taken_s < SAMPLE_STALE_S else time_s)


def depth_points(flight: Flight, time_s: float) -> tuple[Array, np.ndarray] | None:
    """What the camera measured, as points in the world and their colours; None without a plan, which says where the
    camera was."""
    plan, frame = flight.plan_at(time_s), frame_at(flight, time_s)
    if plan is None or frame is None or frame.stamp_ns != plan.frame_ns:
        return None
    seen = frame.points_cam_P3()
    if seen is None:
        return None
    points_cam_P3, colors_P3 = seen
    return rotated(plan.world_from_cam_4, points_cam_P3) + plan.start_pos_world_3, colors_P3


def rotated(wxyz_4: Array, vectors_P3: Array) -> Array:
    """Vectors turned by a unit quaternion."""
    w, axis_3 = wxyz_4[0], wxyz_4[1:]
    across_P3 = 2.0 * np.cross(axis_3, vectors_P3)
    return vectors_P3 + w * across_P3 + np.cross(axis_3, across_P3)


def path_N3(flight: Flight) -> Array:
    """The whole flight's way."""
    own = flight.columns("control", ["pos_world"], max_hz=TRAIL_HZ)
    return own["pos_world"][own.times_s >= begins_s(flight)]


def trails_at(flight: Flight, time_s: float) -> tuple[Array, Array]:
    """Where vehicle and (confirmed) target were during the last half minute."""
    own = flight.columns("control", ["pos_world"], max_hz=TRAIL_HZ)
    target = flight.columns("target", ["pos_world", "confirmed"], max_hz=TRAIL_HZ)
    first, last = np.searchsorted(own.times_s, (time_s - TRAIL_S, time_s + 1e-6))
    t_first, t_last = np.searchsorted(target.times_s, (time_s - TRAIL_S, time_s + 1e-6))
    held = target["confirmed"][t_first:t_last].astype(bool)
    own_N3 = own["pos_world"][first:last]
    return own_N3[np.isfinite(own_N3[:, 0])], target["pos_world"][t_first:t_last][held]


def stops_s(flight: Flight) -> Array:
    """The times that one steps through: each frame; each plan, or controller step, of a log without pictures."""
    for channel in ("rgbd", "plan", "control"):
        if flight.count(channel):
            return flight.times_s(channel)
    return np.zeros(0)


def lattice_columns(flight: Flight, candidates: int) -> int:
    """How many columns the policy's lattice has; one row of all candidates where the header does not tell."""
    try:
        lattice = json.loads(flight.header.policy_contract_json or "{}")["lattice"]
        columns, rows = int(lattice["columns"]), int(lattice["rows"])
    except (ValueError, KeyError, TypeError):
        return max(candidates, 1)
    return columns if columns > 0 and columns * rows == candidates else max(candidates, 1)


def marks_of(flight: Flight) -> tuple[Mark, ...]:
    """What happened, by time: events, phases without one, fallbacks, the closest approach, damage, a cut-off end."""
    marks = [
        Mark(time_s=(e.stamp_ns - flight.start_ns) * 1e-9, severity=e.severity, text=e.text) for e in flight.events
    ]
    told_s = [m.time_s for m in marks if " → " in m.text]
    for phase in flight.phases:
        told = any(abs(phase.start_s - t) < 0.02 for t in told_s)
        if not told and phase.duration_s >= SHORT_S:
            severity = pb.SEVERITY_WARNING if phase.name in ("lost", "fault") else pb.SEVERITY_INFO
            marks.append(Mark(time_s=phase.start_s, severity=severity, text=phase.name))
    marks += [
        Mark(time_s=p.start_s, severity=pb.SEVERITY_WARNING, text=f"fallback: {p.name}, {p.duration_s:.2f} s")
        for p in flight.fallbacks
    ]
    marks += [
        Mark(time_s=t, severity=pb.SEVERITY_ERROR, text="collision")
        for t in _collisions_s(flight)
        if not _told(marks, t)
    ]
    closest = _closest(flight)
    if closest is not None:
        marks.append(closest)
    for damage, missing in zip(flight.log.damage, flight.missing, strict=True):
        at_s = 0.0 if damage.after_ns is None else (damage.after_ns - flight.start_ns) * 1e-9
        marks.append(Mark(time_s=at_s, severity=pb.SEVERITY_ERROR, text=f"the log is damaged: {missing} missing"))
    if not flight.closed and not flight.missing:
        marks.append(Mark(time_s=flight.duration_s, severity=pb.SEVERITY_ERROR, text="the log was cut off here"))
    return tuple(sorted(marks, key=lambda m: m.time_s))


def _closest(flight: Flight) -> Mark | None:
    truth = flight.columns("sim_truth", ["clearance_m", "pos_world"])
    if len(truth) == 0:
        return None
    clearance_M = np.array(truth["clearance_m"], dtype=np.float64)
    # On the ground it is near the ground: only what is flown counts.
    flown = [p for p in flight.phases if p.name in ("tracking", "lost", "search", "navigation", "hold")]
    in_air_M = np.zeros(len(clearance_M), dtype=bool)
    for phase in flown:
        in_air_M |= (truth.times_s >= phase.start_s) & (truth.times_s <= phase.end_s + 0.1)
    known_M = in_air_M & np.isfinite(clearance_M)
    if not known_M.any():
        return None
    clearance_M[~known_M] = np.inf
    nearest = int(np.argmin(clearance_M))
    text = f"closest to an obstacle: {max(clearance_M[nearest], 0.0):.2f} m"
    return Mark(time_s=float(truth.times_s[nearest]), severity=pb.SEVERITY_INFO, text=text)


def _collisions_s(flight: Flight) -> Array:
    """When the simulator saw the vehicle touch something, s."""
    truth = flight.columns("sim_truth", ["collisions"])
    return truth.times_s[1:][np.diff(truth["collisions"].astype(np.int64)) > 0]


def _told(marks: list[Mark], time_s: float) -> bool:
    """A campaign's verdict says what was hit, too."""
    return any(m.text.startswith("collision") and abs(m.time_s - time_s) < 0.1 for m in marks)


def begins_s(flight: Flight) -> float:
    """The first time at which the vehicle knew where it was; before its first odometry there is nothing to show."""
    times_s = flight.times_s("control")[:400]
    return next((float(t) for t in times_s if flight.control_at(float(t)) is not None), 0.0)


def takeoff_s(flight: Flight) -> float:
    """When the take-off began; 0 if it was not recorded."""
    return next((p.start_s for p in flight.phases if p.name == "take-off"), 0.0)


def only_chosen(plan: view.PlanView | None) -> view.PlanView | None:
    """A plan with nothing but the trajectory that was flown; None if nothing was."""
    if plan is None or plan.chosen is None:
        return None
    one = slice(plan.chosen, plan.chosen + 1)
    return replace(
        plan,
        end_pos_world_N3=plan.end_pos_world_N3[one],
        end_vel_world_N3=plan.end_vel_world_N3[one],
        end_acc_world_N3=plan.end_acc_world_N3[one],
        cost_N=plan.cost_N[one],
        added_NP=plan.added_NP[one],
        objectness_N=plan.objectness_N[one],
        rejections=plan.rejections[one],
        target_pos_world_N3=None if plan.target_pos_world_N3 is None else plan.target_pos_world_N3[one],
        chosen=0,
    )


class Replay:
    """Another policy's decisions on the frames of a flight, found again by the frame."""

    def __init__(self, log: Flight) -> None:
        """``log`` holds plans with the frame stamps of the flight."""
        self.log = log
        stamps = log.columns("plan", ["frame_ns"])["frame_ns"]
        self._index = {int(stamp): k for k, stamp in enumerate(stamps)}

    def answers(self, flight: Flight) -> bool:
        """Whether it is of this flight: at least half of its plans are of the flight's frames."""
        stamps = flight.columns("plan", ["frame_ns"])["frame_ns"]
        return len(self._index) > 0 and 2 * sum(int(s) in self._index for s in stamps) >= len(self._index)

    def plan_for(self, plan: view.PlanView | None) -> view.PlanView | None:
        """What the other policy made of the same frame; None if it has no answer."""
        index = None if plan is None else self._index.get(plan.frame_ns)
        return None if index is None else self.log.plan(index)
