"""The messages of a flight one after the other, by time."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator
from dataclasses import dataclass

from google.protobuf.message import Message

from goshawk_dashboards.log.flight import CHANNELS, Flight


@dataclass(frozen=True, kw_only=True)
class Record:
    """One message of a log."""

    channel: str
    """Its short name, a key of CHANNELS."""
    topic: str
    log_ns: int
    """When it was logged, the vehicle's clock."""
    message: Message


def records(flight: Flight) -> Iterator[Record]:
    """Every message that decodes: the header, whose vehicle file the others need, then all else by time."""
    others = [name for name in CHANNELS if name != "header"]
    places = heapq.merge(*(_places(flight, name) for name in others))
    for log_ns, name, index in itertools.chain(_places(flight, "header"), places):
        message = flight.message(name, index)
        if message is not None:
            yield Record(channel=name, topic=CHANNELS[name][0], log_ns=log_ns, message=message)


def _places(flight: Flight, name: str) -> Iterator[tuple[int, str, int]]:
    """Time, channel and index of each of a channel's records."""
    times_ns = flight.log.times_ns(CHANNELS[name][0])
    return ((int(log_ns), name, index) for index, log_ns in enumerate(times_ns))
