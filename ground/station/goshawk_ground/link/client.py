"""The ground's Zenoh client: newest telemetry in, commands out.

It dials the vehicle's endpoint and keeps dialling; nothing is discovered by multicast. Each channel keeps only its
newest sample (events: the newest ``EVENTS``). Zenoh's receiving thread never waits for Python: it fills short rings,
which drop their oldest, and one thread here empties them often. So however busy this process is, what it sees is at
most a fraction of a second old. Losing the vehicle raises nothing: ages grow, and the views say so.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import zenoh
from google.protobuf.message import DecodeError, Message
from goshawk_dashboards.state import decode, protocol
from goshawk_dashboards.state.snapshot import LateView, Snapshot
from goshawk_dashboards.state.views import CommandView, EventView, WorldView
from goshawk_proto import KEYS, goshawk_pb2, key_expression

from goshawk_ground.link import round_trip, silence
from goshawk_ground.link.catch_up import CatchUp
from goshawk_ground.link.channel import ChannelStats
from goshawk_ground.link.dial import LinkError, Way
from goshawk_ground.link.tap import Tap
from goshawk_ground.orders.ask import Starter
from goshawk_ground.orders.stop_file import StopFile
from goshawk_ground.orders.stop_latch import StopLatch

EVENTS = 200
LATE = 800
"""Most samples that are kept of what was told afterwards: as many steps as a chart shows, and a target with each."""
RING = 32
"""Samples of one channel that may wait: half a second of the fastest."""
DRAIN_PERIOD_S = 0.005
PAGE_TIMEOUT_S, PAGE_TRIES = 3.0, 5
"""How long a page of the simulator's world is waited for, and how often it is asked for in vain."""
WORLD_PERIOD_S, ANOTHER_RUN_S = 0.5, 1.0
"""How often a simulator's truth is looked at, and how long it is away where another run of it may have begun."""
HEARTBEAT_S = 3.0
"""A heartbeat as old as this no longer says who the vehicle is: it comes twice a second."""
DEFAULT_CONNECT = "tcp/127.0.0.1:7447"
DEFAULT_VEHICLE = "goshawk"

Listener = Callable[[str, Any], None]

_DECODERS: dict[str, tuple[Any, Callable[[Any], Any]]] = {
    "plan": (goshawk_pb2.Plan, decode.plan),
    "map": (goshawk_pb2.ObstacleMap, decode.remembered),
    "control": (goshawk_pb2.Control, decode.control),
    "target": (goshawk_pb2.Target, decode.target),
    "health": (goshawk_pb2.Health, decode.health),
    "preview": (goshawk_pb2.Preview, decode.preview),
    "event": (goshawk_pb2.Event, decode.event),
    "sim_truth": (goshawk_pb2.SimTruth, decode.truth),
}


class GroundLink:
    """One vehicle, watched and commanded. Every method may be called from any thread."""

    def __init__(
        self,
        *,
        vehicle: str = DEFAULT_VEHICLE,
        connect: str = DEFAULT_CONNECT,
        identity: Path | None = None,
        state: Path | None = None,
    ) -> None:
        """Begins to dial and returns at once; ``identity``: the folder of who we are, for tls and quic.

        ``state``: the folder where a pending Stop is kept, and from which one is taken up; None: it ends with us.
        Raises LinkError if the endpoint or the name cannot be one, or the identity is missing.
        """
        self.vehicle = vehicle
        self.connect = connect
        self._lock = threading.Lock()
        self._stats = {name: ChannelStats(name) for name in _DECODERS}
        self._newest: dict[str, Any] = {}
        self._events: tuple[EventView, ...] = ()
        self._late: tuple[LateView, ...] = ()
        self._process = self._stops_told = 0
        """`Health.session` of the vehicle's process, and its `Health.stops`."""
        self._stop_answered_s = float("-inf")
        self._catch_up = CatchUp(self, self._take_late)
        self._listeners: tuple[Listener, ...] = ()
        self._taps: tuple[Tap, ...] = ()
        self._alive = False
        self._world: WorldView | None = None
        self._command: CommandView | None = None
        self._starter = Starter(self, self._take_command)
        self._round_trip_s: float | None = None
        self._closing = threading.Event()
        try:
            self._keys = {name: key_expression(name, vehicle) for name in KEYS}
        except ValueError as error:
            raise LinkError(str(error)) from error
        self._way = Way(connect, vehicle, identity)
        self._session: zenoh.Session | None = None
        self._declared: list[Any] = []
        self._stops = StopLatch(self, self._take_command, None if state is None else StopFile(state, vehicle))
        self._thread = threading.Thread(target=self._run, name="ground-link", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session; safe to call twice."""
        self._closing.set()
        if self._session is None:
            # It dials still, and zenoh.open would go on for seconds: the end of its way ends it.
            self._way.close()
        self._thread.join(timeout=3.0)
        session, self._session = self._session, None
        if session is not None:
            with contextlib.suppress(zenoh.ZError):
                session.close()
        self._stops.join(timeout_s=2.0)
        self._way.close()

    def _run(self) -> None:
        session = self._way.open(self._closing)
        if session is None:
            return
        if self._closing.is_set():
            # It was answered too late: whoever closes has waited long enough, and nobody else would end it.
            with contextlib.suppress(zenoh.ZError):
                session.close()
            return
        rings = {
            name: session.declare_subscriber(self._keys[name], zenoh.handlers.RingChannel(RING)) for name in _DECODERS
        }
        liveliness = session.liveliness()
        self._declared.append(liveliness.declare_token(self._keys["alive_ground"]))
        # A ring, not a callback: Zenoh calls back from a thread of its own, and one that is caught at the end of the
        # interpreter aborts the process.
        alive = liveliness.declare_subscriber(self._keys["alive_air"], zenoh.handlers.RingChannel(RING), history=True)
        self._declared += [*rings.values(), alive]
        self._session = session
        helpers = [threading.Thread(target=f, daemon=True) for f in (self._watch_world, self._watch_round_trip)]
        helpers.append(threading.Thread(target=self._catch_up.run, args=(self._closing,), daemon=True))
        for helper in helpers:
            helper.start()
        while not self._closing.wait(DRAIN_PERIOD_S):
            while (sample := alive.try_recv()) is not None:
                self._take_alive(sample)
            for name, ring in rings.items():
                while (sample := ring.try_recv()) is not None:
                    self._take(name, sample)
        for helper in helpers:
            helper.join(timeout=2.5)

    # ---- telemetry ----

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Calls ``listener(channel, view)`` for every well-formed sample, on the link's own thread: be quick.

        Returns what ends it.
        """
        with self._lock:
            self._listeners = (*self._listeners, listener)
        return lambda: self._unlisten(listener)

    def _unlisten(self, listener: Listener) -> None:
        with self._lock:
            self._listeners = tuple(kept for kept in self._listeners if kept is not listener)

    def tap(self, *, late: bool = False) -> Tap:
        """Every well-formed message from now on, as it came; ``late``: with what is told after a cut, of earlier."""
        tap = Tap(self._untap, late=late)
        with self._lock:
            self._taps = (*self._taps, tap)
        return tap

    def _untap(self, tap: Tap) -> None:
        with self._lock:
            self._taps = tuple(kept for kept in self._taps if kept is not tap)

    def snapshot(self) -> Snapshot:
        """All that is known now."""
        linked, stop = self.linked, self._stops.view()
        with self._lock:
            now_s = time.monotonic()
            return Snapshot(
                now_s=now_s,
                vehicle=self.vehicle,
                endpoint=self.connect,
                linked=linked,
                alive=self._alive and linked,
                plan=self._newest.get("plan"),
                remembered=self._newest.get("map"),
                control=self._newest.get("control"),
                target=self._newest.get("target"),
                health=self._newest.get("health"),
                preview=self._newest.get("preview"),
                truth=self._newest.get("sim_truth"),
                world=self._world,
                events=self._events,
                late=self._late,
                channels=tuple(stats.view(now_s) for stats in self._stats.values()),
                command=self._command,
                stop=stop,
                round_trip_s=self._round_trip_s,
            )

    @property
    def closing(self) -> bool:
        """Whether ``close`` was called."""
        return self._closing.is_set()

    @property
    def linked(self) -> bool:
        """Whether a transport to the endpoint is open now."""
        session = self._session
        if session is None or self._closing.is_set():
            return False
        info = session.info
        return bool(info.peers_zid() or info.routers_zid())

    def wait_for(self, condition: Callable[[Snapshot], bool], timeout_s: float) -> Snapshot | None:
        """The first snapshot for which ``condition`` holds; None if none did in time."""
        deadline = time.monotonic() + timeout_s
        while True:
            snap = self.snapshot()
            if condition(snap):
                return snap
            if time.monotonic() >= deadline:
                return None
            time.sleep(0.02)

    def _take(self, name: str, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        message_type, decoder = _DECODERS[name]
        try:
            if KEYS[name].names_another(sample.encoding):
                raise DecodeError(f"this is no {name}")
            message = message_type.FromString(payload)
            view = decoder(message)
        except (DecodeError, decode.MalformedError):
            with self._lock:
                self._stats[name].malformed()
            return
        with self._lock:
            self._stats[name].arrived(time.monotonic(), len(payload), getattr(message, "seq", None))
            if name == "event":
                self._add_event(view)
            else:
                self._newest[name] = view
            if isinstance(message, goshawk_pb2.Health):
                self._stops_told = message.stops
            if isinstance(message, goshawk_pb2.Health) and message.session not in (0, self._process):
                # A vehicle that booted anew counts its time anew: what it told before would hide what it tells now.
                self._process = message.session
                self._events = tuple(kept for kept in self._events if kept.stamp_ns <= message.stamp_ns)
                self._late = tuple(kept for kept in self._late if kept.stamp_ns <= message.stamp_ns)
        self._catch_up.heard(message)
        for tap in self._taps:
            tap.put(name, message)
        for listener in self._listeners:
            listener(name, view)

    def _add_event(self, event: EventView) -> bool:
        """In its place in time; False: it is there already."""
        if any((kept.stamp_ns, kept.text) == (event.stamp_ns, event.text) for kept in self._events):
            return False
        self._events = tuple(sorted((*self._events, event), key=lambda kept: kept.stamp_ns)[-EVENTS:])
        return True

    def _take_late(self, name: str, message: Message) -> None:
        """What was missed, told afterwards: it is never the newest, so it is no news for whoever listens."""
        try:
            view = _DECODERS[name][1](message)
        except decode.MalformedError:
            return
        with self._lock:
            if not isinstance(view, EventView):
                self._late = tuple(sorted((*self._late, view), key=lambda kept: kept.stamp_ns)[-LATE:])
            elif not self._add_event(replace(view, late=True)):
                return
        for tap in self._taps:
            if tap.late:
                tap.put(name, message)

    def may_ask(self) -> bool:
        """Whether what was missed may be asked for: the vehicle is there, and no command waits for its answer."""
        stop, command = self._stops.view(), self._command
        return self.linked and (stop is None or stop.lapsed) and not (command is not None and command.pending)

    def _take_alive(self, sample: zenoh.Sample) -> None:
        with self._lock:
            self._alive = sample.kind == zenoh.SampleKind.PUT

    def _watch_world(self) -> None:
        """Asks a simulator for its world, once per run of it; a real vehicle is never asked."""
        known, seen_ns = False, 0
        while not self._closing.wait(WORLD_PERIOD_S):
            with self._lock:
                truth = self._newest.get("sim_truth")
            if truth is None:
                continue
            # One that is started anew on the same machine goes on by the same clock: only its pause tells.
            known = known and 0.0 <= 1e-9 * (truth.stamp_ns - seen_ns) <= ANOTHER_RUN_S
            seen_ns = truth.stamp_ns
            if known:
                continue
            whole = self._ask_world()
            if whole is None:
                continue
            with contextlib.suppress(decode.MalformedError):
                world = decode.world(whole)
                with self._lock:
                    self._world, seen_ns = world, self._newest["sim_truth"].stamp_ns
                known = True

    def _ask_world(self) -> goshawk_pb2.SimWorld | None:
        """All pages of the world; None: the simulator fell silent, or another one answers meanwhile."""
        whole, tries = goshawk_pb2.SimWorld(), 0
        while tries < PAGE_TRIES and not self._closing.is_set():
            have = len(whole.trees) + len(whole.boxes)
            request = goshawk_pb2.SimWorldRequest(first=have)
            page = next(self.ask("sim_world", request, PAGE_TIMEOUT_S), None)
            if not isinstance(page, goshawk_pb2.SimWorld):
                tries += 1
                continue
            got = len(page.trees) + len(page.boxes)
            if have and (page.seed, page.items) != (whole.seed, whole.items):
                return None
            whole.MergeFrom(page)
            if have + got >= page.items:
                return whole
            tries = 0 if got else tries + 1
        return None

    def _watch_round_trip(self) -> None:
        session = self._session
        while session is not None and not self._closing.wait(round_trip.PERIOD_S):
            took_s = round_trip.measure_s(session, self.vehicle)
            with self._lock:
                self._round_trip_s = took_s

    # ---- commands ----

    def start(
        self, profile: str = "", *, timeout_s: float = 5.0, given_up: threading.Event | None = None
    ) -> CommandView:
        """Asks for the flight to begin; ``profile`` empty: the vehicle's default. Returns what became of it.

        It is not asked any more once ``given_up`` is set.
        """
        return self._starter.start(profile, timeout_s, given_up or threading.Event())

    def refuses_start(self, timeout_s: float) -> str:
        """One line: why this ground must not start the vehicle, as soon as a heartbeat tells; empty: nothing is known
        against it."""
        stop = self._stops.view()
        if stop is not None and not stop.lapsed:
            return "a Stop is not confirmed yet: wait until it is, or cancel it"
        snap = self.wait_for(lambda s: self.closing or self._told_since_the_stop(s), timeout_s)
        return "" if snap is None else protocol.mismatch(snap.health)

    def _told_since_the_stop(self, snap: Snapshot) -> bool:
        return snap.fresh("health", min(HEARTBEAT_S, snap.now_s - self._stop_answered_s))

    @property
    def told_stops(self) -> tuple[int, int]:
        """By the newest heartbeat: which process of the vehicle it is, 0 if that is not told, and how many stops were
        asked of it."""
        with self._lock:
            return self._process, self._stops_told

    def press_stop(self) -> CommandView:
        """Asks for the flight to end, until the vehicle confirms it or ``cancel_stop`` is called. Returns at once."""
        return self._stops.press()

    def cancel_stop(self) -> None:
        """Takes a pending Stop back, and forgets a lapsed one."""
        self._stops.cancel()

    def stop_ended(self, timeout_s: float) -> bool:
        """Whether no Stop is pending; waits for that at most ``timeout_s``."""
        return self._stops.wait(timeout_s)

    def give_up_stop(self) -> None:
        """Asks no more for a Stop that is pending, and says so to whoever looks."""
        self._stops.give_up(self.why_undelivered())

    def stop(self, *, timeout_s: float = 5.0) -> CommandView:
        """Asks for the flight to end, for as long as given. Returns what became of it."""
        pressed = self.press_stop()
        if not self.stop_ended(timeout_s):
            self.give_up_stop()
        return self.stop_outcome or pressed

    @property
    def stop_outcome(self) -> CommandView | None:
        """What became of the last Stop that ended; the newest command may be another one."""
        return self._stops.outcome

    @property
    def stops_pressed(self) -> int:
        """How often a Stop was pressed, on this ground or on the one before it."""
        return self._stops.pressed

    def _take_command(self, view: CommandView) -> None:
        """A late reply to an older Start never replaces news of a newer command; what becomes of a Stop always does."""
        with self._lock:
            if view.verb == "stop" and view.answered:
                self._stop_answered_s = time.monotonic()
            kept = self._command
            if kept is None or view.verb == "stop" or (kept.at_s or 0.0) <= (view.at_s or 0.0):
                self._command = view

    def ask(self, key: str, request: Message | None, timeout_s: float) -> Iterator[Message]:
        """The well-formed replies to one query."""
        row = KEYS[key]
        session = self._session
        if row.reply is None or session is None:
            return
        try:
            replies = session.get(
                self._keys[key],
                timeout=timeout_s,
                payload=None if request is None else request.SerializeToString(),
                encoding=row.encoding,
                priority=row.priority,
                congestion_control=row.congestion,
                express=row.express,
            )
            for reply in replies:
                if reply.ok is not None:
                    with contextlib.suppress(DecodeError):
                        yield row.reply.FromString(reply.ok.payload.to_bytes())
        except zenoh.ZError:
            return

    def why_silent(self, waited_s: float) -> str:
        """One line: what to check when the vehicle did not answer within ``waited_s``."""
        return (None if self.linked else self._way.problem) or silence.why_silent(self.snapshot(), waited_s)

    def why_undelivered(self) -> str:
        """What to do now that a Stop is not confirmed, then why it is not."""
        return silence.why_undelivered(self.snapshot())
