"""The messages of a flight one after the other, by time."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

from google.protobuf.message import Message

from goshawk_dashboards.flight import CHANNELS, Flight


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
    """Every message that decodes, by time; the header first."""
    channels = [name for name in ("header", *CHANNELS) if flight.count(name)]
    places = heapq.merge(*(_places(flight, name, rank) for rank, name in enumerate(dict.fromkeys(channels))))
    for log_ns, _, index, name in places:
        message = flight.message(name, index)
        if message is not None:
            yield Record(channel=name, topic=CHANNELS[name][0], log_ns=log_ns, message=message)


def _places(flight: Flight, name: str, rank: int) -> Iterator[tuple[int, int, int, str]]:
    """Time, the channel's rank among those of one time, index, name. The header's own stamp is when it was written,
    which may be after the first telemetry: what follows needs the vehicle file, so it comes first."""
    times_ns = flight.log.times_ns(CHANNELS[name][0])
    return ((0 if name == "header" else int(t), rank, index, name) for index, t in enumerate(times_ns))
