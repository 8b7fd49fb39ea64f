"""What the ground hears of a vehicle, as a flight log: the telemetry's channels in MCAP, for review and report."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path

from google.protobuf.message import Message
from goshawk_proto import KEYS, PROTOCOL, goshawk_pb2
from mcap_protobuf.writer import Writer

from goshawk_ground.link.client import GroundLink
from goshawk_ground.link.tap import Tap, stamp_ns

WAIT_S = 0.2
HEADER = "log/header"


def record(link: GroundLink, path: Path, ended: Callable[[], bool]) -> int:
    """Writes a new file until ``ended``, which is asked several times a second; how many messages it holds.

    It begins with the first heartbeat, which says who the vehicle is, and has what is told after a cut in its place.
    A vehicle that boots anew counts its time anew: that goes into a file of its own, `flight-2.mcap` after
    `flight.mcap`. Raises OSError if a file exists or cannot be written.
    """
    written = 0
    with link.tap(late=True) as tap:
        heard, boot = _heard(tap, ended), 1
        anew: goshawk_pb2.Health | None = None
        while boot == 1 or anew is not None:
            place = path if boot == 1 else path.with_name(f"{path.stem}-{boot}{path.suffix}")
            with place.open("xb") as file, Writer(file) as log:
                count, anew = _write_boot(log, link, heard, anew)
            written, boot = written + count, boot + 1
    return written


def _heard(tap: Tap, ended: Callable[[], bool]) -> Iterator[tuple[str, Message]]:
    while not ended():
        for told in tap.take(WAIT_S):
            yield told
            if ended():
                return


def _write_boot(
    log: Writer, link: GroundLink, heard: Iterator[tuple[str, Message]], first: goshawk_pb2.Health | None
) -> tuple[int, goshawk_pb2.Health | None]:
    """Writes what was told by one clock, from its first heartbeat on. How much; and the first heartbeat by another."""
    began_ns: int | None = None
    newest: goshawk_pb2.Health | None = None
    written = 0
    for channel, message in heard if first is None else itertools.chain([("health", first)], heard):
        at_ns = stamp_ns(channel, message)
        if isinstance(message, goshawk_pb2.Health):
            if newest is not None and newest.session != message.session and at_ns < newest.stamp_ns:
                return written, message
            if began_ns is None:
                began_ns = at_ns
                log.write_message(HEADER, _header(link, message), log_time=at_ns, publish_time=at_ns)
            if newest is None or at_ns > newest.stamp_ns:
                newest = message
        if began_ns is not None and at_ns >= began_ns:
            log.write_message(KEYS[channel].suffix, message, log_time=at_ns, publish_time=at_ns)
            written += 1
    return written, None


def _header(link: GroundLink, health: goshawk_pb2.Health) -> goshawk_pb2.LogHeader:
    began = datetime.fromtimestamp(time.time(), UTC).isoformat(timespec="milliseconds")
    return goshawk_pb2.LogHeader(
        vehicle=health.vehicle or link.vehicle,
        policy_sha256=health.policy_sha256,
        version=health.version,
        profile=health.profile,
        protocol=PROTOCOL,
        wall_time=began.replace("+00:00", "Z"),
        stamp_ns=health.stamp_ns,
    )
