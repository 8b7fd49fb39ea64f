"""What the ground hears of a vehicle, as a flight log: the telemetry's channels in MCAP, for review and report."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from goshawk_proto import KEYS, PROTOCOL, goshawk_pb2
from mcap_protobuf.writer import Writer

from goshawk_ground.link.client import GroundLink
from goshawk_ground.link.tap import stamp_ns

WAIT_S = 0.2
HEADER = "log/header"


def record(link: GroundLink, path: Path, ended: Callable[[], bool]) -> int:
    """Writes a new file until ``ended``, which is asked several times a second; how many messages it holds.

    It begins with the first heartbeat, which says who the vehicle is, and has what is told after a cut in its place.
    Raises OSError if the file exists or cannot be written.
    """
    written = 0
    with link.tap(late=True) as tap, path.open("xb") as file, Writer(file) as log:
        began_ns: int | None = None
        while not ended():
            for channel, message in tap.take(WAIT_S):
                at_ns = stamp_ns(channel, message)
                if began_ns is None and isinstance(message, goshawk_pb2.Health):
                    began_ns = at_ns
                    log.write_message(HEADER, _header(link, message), log_time=at_ns, publish_time=at_ns)
                if began_ns is not None and at_ns >= began_ns:
                    log.write_message(KEYS[channel].suffix, message, log_time=at_ns, publish_time=at_ns)
                    written += 1
                if ended():
                    break
    return written


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
