"""Everything a dashboard can show at one instant: of a vehicle that flies now, or of a recording."""

from __future__ import annotations

from dataclasses import dataclass

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.state.views import (
    AutopilotView,
    ChannelView,
    CommandView,
    ControlView,
    EventView,
    HealthView,
    PlanView,
    PreviewView,
    RememberedView,
    StopView,
    TargetView,
    TruthView,
    WorldView,
)

STALE_S = 1.5
"""A vehicle not heard for this long is stale: three times the heartbeat's period, and the link's lease is 2 s."""
SAMPLE_STALE_S = 1.0
"""What is older than this is not shown as if it were now: a plan, a controller step, an estimate, the truth.

The vehicle itself calls a plan stale sooner, by its own clock (`PLAN_STALE_S` of its health check). Here an age counts
from the arrival, so what the link lost or held back is in it too. With the vehicle's limit a weak link would make the
view flicker in a flight in which nothing is wrong. The review keeps to it, so that it shows what was to be seen.
"""
MAP_STALE_S = 3.0
"""The same for what the planner remembers, which comes once a second."""
FLYING = frozenset({pb.MODE_TAKEOFF, pb.MODE_TRACK, pb.MODE_NAVIGATE, pb.MODE_SEARCH, pb.MODE_HOLD, pb.MODE_STOPPING})
"""The modes in which the vehicle flies by itself."""
IN_AIR = FLYING | {pb.MODE_FAULT}
"""The modes in which it is, or may be, in the air: after a fault somebody else flies it, until its motors are off."""


LateView = ControlView | HealthView | TargetView
"""What is told after a cut about its alerts."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Snapshot:
    """All that is known about one vehicle now."""

    now_s: float
    """The ground's monotonic clock."""
    vehicle: str
    endpoint: str
    linked: bool
    """A transport to the endpoint is open."""
    alive: bool
    """The vehicle's liveliness token is present."""
    plan: PlanView | None = None
    remembered: RememberedView | None = None
    control: ControlView | None = None
    target: TargetView | None = None
    health: HealthView | None = None
    preview: PreviewView | None = None
    truth: TruthView | None = None
    world: WorldView | None = None
    events: tuple[EventView, ...] = ()
    """The newest last; bounded."""
    late: tuple[LateView, ...] = ()
    """What was told afterwards about the alerts of a time in which the link was away, by its time; bounded."""
    channels: tuple[ChannelView, ...] = ()
    command: CommandView | None = None
    stop: StopView | None = None
    """The Stop that is pending or lapsed; None: there is none."""
    round_trip_s: float | None = None
    """The newest round trip to the vehicle's own process; infinite: unanswered; None: not yet measured."""
    autopilot: AutopilotView | None = None
    """None: no telemetry radio is configured."""

    def age_s(self, channel: str) -> float | None:
        """Seconds since the channel's last sample; None if none came."""
        for view in self.channels:
            if view.name == channel:
                return view.age_s
        return None

    def fresh(self, channel: str, limit_s: float = SAMPLE_STALE_S) -> bool:
        """Whether the channel's last sample is at most ``limit_s`` old."""
        age_s = self.age_s(channel)
        return age_s is not None and age_s <= limit_s

    @property
    def mode(self) -> pb.Mode | None:
        """The vehicle's mode from whichever of control and health arrived last; None: not heard."""
        control_age, health_age = self.age_s("control"), self.age_s("health")
        if self.control is not None and (health_age is None or (control_age or 0.0) <= health_age):
            return self.control.mode
        return self.health.mode if self.health is not None else None

    @property
    def heard_age_s(self) -> float | None:
        """Seconds since anything at all came from the vehicle itself; None: nothing ever did."""
        ages = [c.age_s for c in self.channels if c.name != "sim_truth" and c.age_s is not None]
        return min(ages) if ages else None

    @property
    def stale(self) -> bool:
        """Whether what is known is no longer what is."""
        age_s = self.heard_age_s
        return age_s is None or age_s > STALE_S

    @property
    def flying(self) -> bool:
        """Whether the vehicle was, or may have been, in the air when it was last heard."""
        return self.mode in IN_AIR
