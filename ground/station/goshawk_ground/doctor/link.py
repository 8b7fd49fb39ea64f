"""The link to the vehicle, as `goshawk doctor` measures it: is it there, how far away, how far off is its clock."""

from __future__ import annotations

import contextlib
import math
import statistics
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import zenoh
from google.protobuf.message import DecodeError
from goshawk_proto import KEYS, key_expression
from goshawk_proto import goshawk_pb2 as pb

from goshawk_ground.doctor.findings import Finding, State, ok
from goshawk_ground.link import round_trip
from goshawk_ground.link.dial import Way

ROUND_TRIPS = 10
LISTEN_S = 1.5
"""Longer than a heartbeat's period."""
SLOW_MS = 100.0


@dataclass(frozen=True, kw_only=True)
class LinkFacts:
    """What was measured. None: not to be had."""

    connect: str
    vehicle: str
    reachable: bool
    """Somebody answers at the endpoint."""
    round_trips_ms: tuple[float, ...] = ()
    """Of requests that the vehicle's own session answers; none: no such vehicle there."""
    clock_offset_ms: float | None = None
    """The vehicle's clock less the ground's monotonic one."""
    version: str | None = None
    problem: str | None = None
    """Why the endpoint was not reached, one line, as far as that is known."""


def measure(vehicle: str, connect: str, timeout_s: float, identity: Path | None = None) -> LinkFacts:
    """Dials, asks and listens. Sends no command. Raises LinkError or ValueError for a bad endpoint or name."""
    keys = {name: key_expression(name, vehicle) for name in ("health", "control")}
    with contextlib.closing(Way(connect, vehicle, identity)) as way:
        return _measure(way, LinkFacts(connect=connect, vehicle=vehicle, reachable=False), keys, timeout_s)


def _measure(way: Way, nobody: LinkFacts, keys: dict[str, str], timeout_s: float) -> LinkFacts:
    giving_up = threading.Event()
    timer = threading.Timer(timeout_s, giving_up.set)
    timer.daemon = True
    timer.start()
    session = way.open(giving_up)
    timer.cancel()
    if session is None:
        return replace(nobody, problem=way.problem)
    with session:
        arrivals = _Arrivals(session, keys)
        deadline = time.monotonic() + timeout_s
        trips: list[float] = []
        while len(trips) < ROUND_TRIPS and time.monotonic() < deadline:
            took_s = round_trip.measure_s(session, nobody.vehicle, max(0.1, deadline - time.monotonic()))
            if math.isfinite(took_s):
                trips.append(took_s * 1e3)
            else:
                time.sleep(0.1)
        if trips:
            arrivals.wait(LISTEN_S)
        # A sample is half a round trip old when it arrives; the one that waited least tells the most.
        late_ms = arrivals.least_late_ms
        offset_ms = None if late_ms is None or not trips else 0.5 * min(trips) - late_ms
        return replace(
            nobody,
            reachable=True,
            round_trips_ms=tuple(trips),
            clock_offset_ms=offset_ms,
            version=arrivals.version,
        )


class _Arrivals:
    """Listens to the vehicle's stamps."""

    def __init__(self, session: zenoh.Session, keys: dict[str, str]) -> None:
        self.least_late_ms: float | None = None
        """Smallest of the ground's clock at arrival less the stamp."""
        self.version: str | None = None
        self._heard = threading.Event()
        self._subscribers = [
            session.declare_subscriber(keys["control"], lambda sample: self._take("control", sample, pb.Control())),
            session.declare_subscriber(keys["health"], lambda sample: self._take("health", sample, pb.Health())),
        ]

    def wait(self, seconds: float) -> None:
        """Until a heartbeat has come, at most so long."""
        self._heard.wait(seconds)

    def _take(self, name: str, sample: zenoh.Sample, message: pb.Control | pb.Health) -> None:
        now_ns = time.monotonic_ns()
        if KEYS[name].names_another(sample.encoding):
            return
        try:
            message.ParseFromString(sample.payload.to_bytes())
        except DecodeError:
            return
        late_ms = (now_ns - message.stamp_ns) * 1e-6
        self.least_late_ms = late_ms if self.least_late_ms is None else min(self.least_late_ms, late_ms)
        if isinstance(message, pb.Health):
            self.version = message.version
            self._heard.set()


def link_findings(facts: LinkFacts, own_version: str) -> Iterator[Finding]:
    """The lines about the link. Pure."""
    if not facts.reachable:
        yield Finding(
            name="link",
            state=State.BAD,
            text=f"nobody answers at {facts.connect}" + (f": {facts.problem}" if facts.problem else ""),
            todo="start goshawk-air there, check --connect, the cable and the firewall; or --offline to leave it out",
        )
        return
    if not facts.round_trips_ms:
        yield Finding(
            name="link",
            state=State.BAD,
            text=f"{facts.connect} answers, but no vehicle is named '{facts.vehicle}' there",
            todo="check --vehicle against the name in its vehicle file",
        )
        return
    yield ok("link", f"'{facts.vehicle}' at {facts.connect}")
    median_ms = statistics.median(facts.round_trips_ms)
    text = f"median {median_ms:.1f} ms, max {max(facts.round_trips_ms):.1f} ms of {len(facts.round_trips_ms)}"
    if median_ms <= SLOW_MS:
        yield ok("round trip", text)
    else:
        todo = "come nearer or use another band: Start and Stop still arrive, the view is late"
        yield Finding(name="round trip", state=State.NOTE, text=text, todo=todo)
    if facts.clock_offset_ms is None:
        todo = "wait for readiness, then look again: goshawk status says what it lacks"
        yield Finding(name="clock", state=State.NOTE, text="no telemetry came, so no offset", todo=todo)
    else:
        ahead = "ahead of" if facts.clock_offset_ms >= 0.0 else "behind"
        offset_s = abs(facts.clock_offset_ms) * 1e-3
        error_ms = 0.5 * min(facts.round_trips_ms)
        yield ok(
            "clock", f"the vehicle's is {offset_s:.4f} s {ahead} this machine's (± {error_ms:.1f} ms and its queues)"
        )
    if facts.version is not None and facts.version != own_version:
        text = f"the vehicle's is {facts.version}, the ground's {own_version}"
        yield Finding(name="version", state=State.NOTE, text=text, todo="install the same revision on both")
    elif facts.version is not None:
        yield ok("version", f"{facts.version} on both sides")
