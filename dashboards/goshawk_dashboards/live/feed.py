"""What all who look at one vehicle share: its newest snapshot, the curves of its plots, its alerts, and the words."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from goshawk_dashboards.instruments.panel import panel_html
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.live import plots
from goshawk_dashboards.live.candidates import picture_html, strip_html
from goshawk_dashboards.live.link import link_html, radio_html
from goshawk_dashboards.page.candidates import table_html
from goshawk_dashboards.page.status import (
    command_html,
    events_html,
    readiness_html,
    status_html,
    vehicle_html,
)
from goshawk_dashboards.scene.relief import Relief
from goshawk_dashboards.state.airborne import took_off
from goshawk_dashboards.state.alerts import Alert, AlertBoard
from goshawk_dashboards.state.snapshot import LateView, Snapshot
from goshawk_dashboards.state.views import ChannelView, CommandView, ControlView, HealthView, TargetView, WorldView

MAX_ALERTS = 4
"""Lines of the banner; the worst come first, and the rest is counted."""

TOGETHER_NS = 200_000_000
"""Of what is told after a cut, a target belongs to a controller step so near in time: both come five times a second."""


@dataclass(frozen=True, kw_only=True)
class Watched:
    """One vehicle as the dashboard needs it, safe from any thread; only ``on_start`` waits for the vehicle."""

    name: str
    latest: Callable[[], Snapshot]
    on_start: Callable[[str], CommandView]
    """Takes a start profile; empty: the vehicle's default."""
    on_stop: Callable[[], object]
    """Asks until the vehicle confirms."""
    on_cancel: Callable[[], object]
    """Takes a Stop back that is not confirmed."""


class Words:
    """What the panels say of one snapshot, each part made when somebody first shows it."""

    def __init__(self, snap: Snapshot, track: Track, ground_z_m: float | None) -> None:
        self._snap = snap
        self._track = track
        self._ground_z_m = ground_z_m
        self._fresh = snap.fresh("plan")

    @cached_property
    def status(self) -> str:
        """The card at the top."""
        control = self._snap.control
        flight_s = None if control is None else self._track.flight_s(control.stamp_ns)
        return status_html(self._snap, flight_s=flight_s, ground_z_m=self._ground_z_m)

    @cached_property
    def command(self) -> str:
        """What became of the last command."""
        return command_html(self._snap)

    @cached_property
    def readiness(self) -> str:
        """Each check."""
        return readiness_html(self._snap)

    @cached_property
    def link(self) -> str:
        """How telemetry arrives."""
        return link_html(self._snap)

    @cached_property
    def radio(self) -> str:
        """What the autopilot says by radio."""
        return radio_html(self._snap)

    @cached_property
    def vehicle(self) -> str:
        """The heartbeat's figures."""
        return vehicle_html(self._snap)

    @cached_property
    def events(self) -> str:
        """The newest events."""
        return events_html(self._snap, took_off_ns=self._track.took_off_ns)

    @cached_property
    def picture(self) -> str:
        """What the camera sees, with the candidates over it."""
        return picture_html(self._snap, fresh=self._fresh)

    @cached_property
    def instruments(self) -> str:
        """Both estimates, in numbers and charts."""
        return panel_html(self._snap, self._track)

    @cached_property
    def candidates(self) -> str:
        """The candidates in figures and words."""
        return table_html(self._snap.plan if self._fresh else None)

    @cached_property
    def strip(self) -> str:
        """The candidates in a row."""
        return strip_html(self._snap, fresh=self._fresh)


def then(snap: Snapshot, view: ControlView | HealthView, targets: Sequence[TargetView]) -> Snapshot:
    """The same vehicle when it said ``view``, of which nothing else is known but the ``targets`` of about then."""
    control, health = (view, None) if isinstance(view, ControlView) else (None, view)

    def off_ns(target: TargetView) -> int:
        return abs(target.stamp_ns - view.stamp_ns)

    target = min(targets, key=off_ns, default=None)
    if target is None or off_ns(target) > TOGETHER_NS:
        return replace(snap, control=control, health=health, target=None, channels=(), round_trip_s=None)
    fresh = ChannelView(
        name="target", count=1, age_s=0.0, rate_hz=0.0, bytes_per_s=0.0, loss_fraction=None, malformed=0
    )
    return replace(snap, control=control, health=health, target=target, channels=(fresh,), round_trip_s=None)


class Feed:
    """One vehicle. Only the thread that draws may call it."""

    def __init__(self, vehicle: Watched) -> None:
        self.vehicle = vehicle
        self.snap = vehicle.latest()
        self.track = Track()
        self._relief: tuple[WorldView, Relief] | None = None
        self.words = Words(self.snap, self.track, None)
        self.curves = tuple(plots.Curves(kind) for kind in plots.KINDS)
        self.alerts: list[Alert] = []
        self._late: tuple[LateView, ...] = ()
        self._board = AlertBoard()

    def take(self, snap: Snapshot) -> None:
        """Goes on to a snapshot."""
        self.snap = snap  # first: whatever fails below, an old one must not look fresh
        self.track.add(snap)
        for event in snap.events:
            if event.late and took_off(event.kind, event.text):
                self.track.tell_take_off(event.stamp_ns)
        self.words = Words(snap, self.track, self._ground_z_m(snap))
        for curves in self.curves:
            curves.sample(snap)
        self._fill(snap)

    def _fill(self, snap: Snapshot) -> None:
        """Draws what was told afterwards into the gaps of the charts."""
        known, self._late = self._late, snap.late
        if snap.late is known:
            return
        targets = [view for view in snap.late if isinstance(view, TargetView)]
        for view in snap.late:
            if not isinstance(view, TargetView) and not any(view is kept for kept in known):
                moment = then(snap, view, targets)
                self.track.fill(moment)
                for curves in self.curves:
                    curves.fill(moment)

    def _ground_z_m(self, snap: Snapshot) -> float | None:
        """Of the ground below it in a simulated world, else of the ground that it took off from."""
        if snap.world is not None and (self._relief is None or self._relief[0] is not snap.world):
            self._relief = (snap.world, Relief(snap.world))
        if self._relief is None or snap.control is None or not self._relief[1].known:
            return self.track.stood_z_m
        return float(self._relief[1].height_M(snap.control.pos_world_3[None, :2])[0])

    def judge(self) -> None:
        """Works out the alerts, as often as they are shown."""
        self.alerts = self._board.update(self.snap)


def worst_alerts(feeds: Sequence[Feed]) -> list[tuple[str, Alert]]:
    """Of all vehicles, the severe first, each with its vehicle's name if there are several."""
    found = [(feed.vehicle.name if len(feeds) > 1 else "", alert) for feed in feeds for alert in feed.alerts]
    found.sort(key=lambda pair: (pair[1].over, not pair[1].severe))
    if len(found) > MAX_ALERTS:
        more = Alert(key="more", severe=False, text=f"and {len(found) - MAX_ALERTS} more")
        return [*found[:MAX_ALERTS], ("", more)]
    return found
