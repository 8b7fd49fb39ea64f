"""A recorded flight, read back: the one reader that review, reports and exports share.

    flight = Flight.open(Path("flight.mcap"))
    plan = flight.plan_at(12.5)                                  # the newest plan at that second, as a PlanView
    speed = flight.columns("control", ["vel_world"], max_hz=20)  # numpy columns, decoded when asked for
    for phase in flight.phases: print(phase.name, phase.start_s, phase.end_s)

Times are seconds since the first record of telemetry (``start_ns`` on the vehicle's clock) unless a name ends in
``_ns``. Shape suffixes: M records, S controller steps, 3 a vector, 4 a quaternion (w, x, y, z).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from google.protobuf.message import DecodeError, Message
from goshawk_proto import KEYS, PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from numpy.typing import NDArray

from goshawk_dashboards.log.columns import Columns, read_columns
from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.log.mcap_file import Damage, ForeignLogError, LogError, McapLog, first_message
from goshawk_dashboards.log.phases import Phase, phases_of
from goshawk_dashboards.log.progress import Progress, unheard
from goshawk_dashboards.state import decode, words
from goshawk_dashboards.state import views as view
from goshawk_dashboards.state.airborne import Ground, Step

__all__ = ["CHANNELS", "Columns", "Flight", "ForeignLogError", "LogError", "header_of"]

Array = view.Array
View = TypeVar("View")

CHANNELS: Mapping[str, tuple[str, type[Message]]] = {
    **{
        name: (KEYS[name].suffix, message)
        for name, message in (
            ("control", pb.Control),
            ("plan", pb.Plan),
            ("map", pb.ObstacleMap),
            ("target", pb.Target),
            ("health", pb.Health),
            ("preview", pb.Preview),
            ("event", pb.Event),
            ("sim_truth", pb.SimTruth),
        )
    },
    "header": ("log/header", pb.LogHeader),
    "rgbd": ("log/rgbd", pb.CompressedRgbd),
    "odometry": ("log/odometry", pb.Odometry),
    "imu": ("log/imu", pb.Imu),
    "command": ("log/command", pb.CommandRecord),
    "planner_input": ("log/planner_input", pb.PlannerInput),
    "controller_input": ("log/controller_input", pb.ControllerInput),
    "world": ("log/world", pb.SimWorld),
}
"""A channel's short name → its topic and message. Not every log has every channel."""


TARGET_FIELDS = ("pos_world", "vel_world", "confirmed", "since_seen_s")
"""What phases, plots and reports ask of the target filter: the same columns, decoded once."""


class Flight:
    """One flight log, complete, cut off or damaged. For one thread at a time."""

    def __init__(self, log: McapLog, *, start_ns: int | None = None) -> None:
        """Raises LogError if it is MCAP but not of ours, or of another protocol."""
        ours = {topic for topic, _ in CHANNELS.values()}
        if ours.isdisjoint(log.topics):
            # In LZ4 or without chunks no record is found; the summary of a whole file tells its channels nevertheless.
            if log.topics or (log.declared and ours.isdisjoint(log.declared)):
                raise ForeignLogError(f"{log.path} is no flight log: none of its channels is Goshawk's")
            raise LogError(f"{log.path} is no flight log: it holds no whole record")
        self.log = log
        self.path = log.path
        timeless = {CHANNELS["header"][0], CHANNELS["world"][0]}
        told = [t for t in log.topics if t not in timeless and len(log.times_ns(t))] or list(log.topics)
        first_ns = min(int(log.times_ns(t)[0]) for t in told)
        self.start_ns = first_ns if start_ns is None else start_ns
        self.end_ns = max(int(log.times_ns(t)[-1]) for t in told)
        self._messages: dict[str, tuple[int, Message]] = {}
        self._columns: dict[tuple[str, tuple[str, ...], float | None], Columns] = {}
        self.malformed = 0
        """Records met so far that make no sense and are shown as absent."""
        if self.count("header") and self.header.protocol != PROTOCOL:
            raise LogError(
                f"{log.path} is of protocol {self.header.protocol}, this software reads {PROTOCOL}: open it with the "
                f"version that recorded it ({self.header.version or 'unknown'})"
            )

    @classmethod
    def open(cls, path: Path, *, start_ns: int | None = None, progress: Progress = unheard) -> Flight:
        """Opens a file; ``start_ns`` puts its second 0 where another log of the same clock has it.

        Raises LogError, one line, if it cannot be read or is no flight log.
        """
        return cls(McapLog(path, progress), start_ns=start_ns)

    def again(self) -> Flight:
        """The same flight for another thread."""
        return Flight(self.log.again(), start_ns=self.start_ns)

    @property
    def closed(self) -> bool:
        """Whether its writer finished it; False after a kill or a power cut, and what is there ends earlier."""
        return self.log.closed

    @property
    def missing(self) -> tuple[str, ...]:
        """Which seconds a damaged log lacks, a phrase each; empty: it is whole, or was only cut off."""
        return tuple(self._missing(damage) for damage in self.log.damage)

    @property
    def completeness(self) -> str:
        """ "complete", "cut off", or "damaged" with the seconds that are missing."""
        whole = "complete" if self.closed else "cut off"
        return f"damaged: {', '.join(self.missing)} missing" if self.missing else whole

    @property
    def duration_s(self) -> float:
        """Seconds from second 0 to the last record."""
        return (self.end_ns - self.start_ns) * 1e-9

    @cached_property
    def header(self) -> pb.LogHeader:
        """Vehicle file, policy, version; an empty one if the log has none."""
        found = self._message("header", 0) if self.count("header") else None
        return found if isinstance(found, pb.LogHeader) else pb.LogHeader()

    def count(self, channel: str) -> int:
        """How many records a channel (a name of CHANNELS) has."""
        return len(self.log.times_ns(CHANNELS[channel][0]))

    def times_s(self, channel: str) -> Array:
        """The time of each record of a channel, ascending."""
        since_ns = self.log.times_ns(CHANNELS[channel][0]) - self.start_ns
        return since_ns.astype(np.float64) * 1e-9

    def index_at(self, channel: str, time_s: float) -> int | None:
        """The newest record at or before a time; None: there is none yet."""
        # The time goes to the integer clock: half a microsecond forgives a double's rounding.
        stamp_ns = self.start_ns + round(time_s * 1e9) + 500
        index = int(np.searchsorted(self.log.times_ns(CHANNELS[channel][0]), stamp_ns, side="right")) - 1
        return index if index >= 0 else None

    def time_s(self, channel: str, index: int) -> float:
        """The time of one record. Raises IndexError."""
        return (int(self.log.times_ns(CHANNELS[channel][0])[index]) - self.start_ns) * 1e-9

    def message(self, channel: str, index: int) -> Message | None:
        """One record as its protobuf message; None if it does not decode. Raises IndexError."""
        return self._message(channel, index)

    def plan(self, index: int) -> view.PlanView | None:
        """One plan; None if it makes no sense. Raises IndexError."""
        return self._view("plan", index, decode.plan)

    def plan_at(self, time_s: float) -> view.PlanView | None:
        """The newest plan at a time."""
        return self._view_at("plan", time_s, decode.plan)

    def remembered_at(self, time_s: float) -> view.RememberedView | None:
        """What the planner remembered by then to stand about it, as it told last."""
        return self._view_at("map", time_s, decode.remembered)

    def control_at(self, time_s: float) -> view.ControlView | None:
        """The newest controller step at a time."""
        return self._view_at("control", time_s, decode.control)

    def target_at(self, time_s: float) -> view.TargetView | None:
        """The newest estimate of the target at a time."""
        return self._view_at("target", time_s, decode.target)

    def health_at(self, time_s: float) -> view.HealthView | None:
        """The newest heartbeat at a time."""
        return self._view_at("health", time_s, decode.health)

    def truth_at(self, time_s: float) -> view.TruthView | None:
        """The simulator's truth at a time; real flights and demonstrations have none."""
        return self._view_at("sim_truth", time_s, decode.truth)

    def frame_at(self, time_s: float) -> FrameView | None:
        """The newest RGB-D frame at a time, still compressed."""
        return self._view_at("rgbd", time_s, FrameView.of)

    def preview_at(self, time_s: float) -> view.PreviewView | None:
        """The newest small picture that the link brought; only what a ground recorded has any."""
        return self._view_at("preview", time_s, decode.preview)

    @cached_property
    def world(self) -> view.WorldView | None:
        """The simulator's world; None where it was not logged."""
        return self._view("world", 0, decode.world) if self.count("world") else None

    @cached_property
    def events(self) -> tuple[view.EventView, ...]:
        """What the vehicle told of itself, oldest first."""
        found = (self._view("event", k, decode.event) for k in range(self.count("event")))
        return tuple(e for e in found if e is not None)

    @property
    def chosen_cost(self) -> tuple[Array, Array]:
        """The time of each plan and the cost of the candidate that it chose, NaN where it chose none."""
        return self.times_s("plan"), self._chosen_M2[:, 1]

    @property
    def chosen_number(self) -> tuple[Array, Array]:
        """The time of each plan and which candidate it chose, counted from 1, NaN where it chose none."""
        return self.times_s("plan"), self._chosen_M2[:, 0]

    @cached_property
    def _chosen_M2(self) -> Array:
        found = [_chosen(self._message("plan", k)) for k in range(self.count("plan"))]
        return np.array(found, dtype=np.float64).reshape(-1, 2)

    @cached_property
    def phases(self) -> tuple[Phase, ...]:
        """The flight from its first controller step to its last as intervals without gaps: see phases.py."""
        target = self.columns("target", TARGET_FIELDS)
        return phases_of(self._modes.times_s, self._modes["mode"], target.times_s, target.fields)

    @cached_property
    def fallbacks(self) -> tuple[Phase, ...]:
        """The intervals in which the controller was below the top of its ladder, named by the rung."""
        runs = Phase.runs(self._modes.times_s, self._modes["fallback"])
        below = [p for p in runs if int(p.name) != pb.FALLBACK_NONE]
        return tuple(replace(p, name=words.fallback(int(p.name))) for p in below)

    def airborne_M(self, times_s_M: Array) -> NDArray[np.bool_]:
        """Whether it was in the air at each of these times, by the newest controller step."""
        steps_s, flown_S = self._airborne
        newest_M = np.searchsorted(steps_s, times_s_M, side="right") - 1
        return (newest_M >= 0) & np.append(flown_S, False)[newest_M]

    @cached_property
    def _airborne(self) -> tuple[Array, NDArray[np.bool_]]:
        """The time of each controller step, and whether it was made in the air."""
        own, ground = self.columns("control", ["mode", "pos_world", "vel_world", "acc_att_world"]), Ground()
        flown: list[bool] = []
        ups = (own[name][:, 2].tolist() for name in ("pos_world", "vel_world", "acc_att_world"))
        for time_s, mode, *up in zip(own.times_s.tolist(), own["mode"].tolist(), *ups, strict=True):
            step = Step(round(time_s * 1e9), mode, *up)
            ground.take(step)
            flown.append(ground.airborne(step))
        return own.times_s, np.array(flown, dtype=bool)

    @cached_property
    def _modes(self) -> Columns:
        return self.columns("control", ["mode", "fallback"])

    def columns(self, channel: str, fields: Sequence[str], *, max_hz: float | None = None) -> Columns:
        """Fields of a channel's records as arrays, decoded at the first call and kept.

        A number or bool is (M,), a Vec3 (M, 3), a Quat (M, 4); an unset vector or optional number is NaN.
        ``max_hz`` takes records at least that far apart. Records that do not decode are left out. Raises KeyError for
        a field that the message does not have.
        """
        key = (channel, tuple(fields), max_hz)
        if key not in self._columns:
            topic, kind = CHANNELS[channel]
            self._columns[key] = read_columns(
                kind, fields, self.times_s(channel), lambda index: self.log.payload(topic, index), max_hz
            )
        return self._columns[key]

    def _missing(self, damage: Damage) -> str:
        def second(time_ns: int | None, else_say: str) -> str:
            return else_say if time_ns is None else f"{(time_ns - self.start_ns) * 1e-9:.2f} s"

        return f"{second(damage.after_ns, 'begin')} to {second(damage.before_ns, 'end')}"

    def _message(self, channel: str, index: int) -> Message | None:
        # The newest one of each channel is kept: a scene asks for the same record many times while it is current.
        have = self._messages.get(channel)
        if have is not None and have[0] == index:
            return have[1]
        topic, kind = CHANNELS[channel]
        message = kind()
        try:
            message.ParseFromString(self.log.payload(topic, index))
        except DecodeError:
            self.malformed += 1
            return None
        self._messages[channel] = (index, message)
        return message

    def _view(self, channel: str, index: int, make: Callable[[Any], View]) -> View | None:
        message = self._message(channel, index)
        if message is None:
            return None
        try:
            return make(message)
        except decode.MalformedError:
            self.malformed += 1
            return None

    def _view_at(self, channel: str, time_s: float, make: Callable[[Any], View]) -> View | None:
        index = self.index_at(channel, time_s)
        return None if index is None else self._view(channel, index, make)


def header_of(path: Path) -> pb.LogHeader | None:
    """What a log begins with, without the rest of it; None if that cannot be read or is not of ours."""
    try:
        return pb.LogHeader.FromString(first_message(path, CHANNELS["header"][0]))
    except (LogError, DecodeError):
        return None


def _chosen(plan: Message | None) -> tuple[float, float]:
    """Number and cost."""
    if not isinstance(plan, pb.Plan) or not plan.HasField("chosen") or plan.chosen >= len(plan.candidates):
        return float("nan"), float("nan")
    return plan.chosen + 1.0, plan.candidates[plan.chosen].cost
