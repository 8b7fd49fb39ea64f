"""What was flown with other parameters than the flight before: vehicle file, tuning file, policy, version."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, cast

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.log.flight import Flight, header_of
from goshawk_dashboards.log.recover import recovered_from

MOST_TRIED = 5
"""Logs before this one, until one is of the same vehicle."""
ABSENT = "–"


@dataclass(frozen=True, kw_only=True)
class Change:
    """A parameter that differs."""

    name: str
    before: str
    now: str


@dataclass(frozen=True, kw_only=True)
class Earlier:
    """What is known of a flight that another one is compared with."""

    name: str
    header: pb.LogHeader


def flight_before(flight: Flight) -> Earlier | None:
    """The newest log beside a flight's that is older, by name as the vehicle names them, and of the same vehicle.

    A recovered log, or the one that it was made of, is no other flight.
    """
    path, now = flight.path, flight.header
    beside = (p for p in path.parent.glob("*.mcap") if p.name < path.name and p != recovered_from(path))
    for candidate in sorted(beside, reverse=True)[:MOST_TRIED]:
        header = header_of(candidate)
        if header is not None and header.vehicle == now.vehicle and not _one_flight(header, now):
            return Earlier(name=candidate.name, header=header)
    return None


def _one_flight(a: pb.LogHeader, b: pb.LogHeader) -> bool:
    """Simulated flights have no date, and all begin at one stamp."""
    return bool(a.wall_time) and (a.wall_time, a.stamp_ns) == (b.wall_time, b.stamp_ns)


def changes(before: pb.LogHeader, now: pb.LogHeader) -> list[Change]:
    """All that differs, by name."""
    old, new = _parameters(before), _parameters(now)
    return [
        Change(name=name, before=old.get(name, ABSENT), now=new.get(name, ABSENT))
        for name in sorted(old.keys() | new.keys())
        if old.get(name) != new.get(name)
    ]


def _parameters(header: pb.LogHeader) -> dict[str, str]:
    found = {
        "policy": header.policy_sha256[:12],
        "profile": header.profile,
        "version": header.version,
        "revision": header.git_revision[:12],
    }
    for file, text in (("vehicle", header.vehicle_toml), ("tuning", header.tuning_toml)):
        try:
            found |= {f"{file}: {name}": value for name, value in _flat(tomllib.loads(text))}
        except tomllib.TOMLDecodeError:
            found[f"{file} file"] = "unreadable"
    return {name: value for name, value in found.items() if value}


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Every value with its dotted name; tables in a list go by their ``name``, else by their place."""
    for name, value in table.items():
        match value:
            case dict():
                yield from _flat(cast(Mapping[str, Any], value), f"{prefix}{name}.")
            case [dict(), *_]:
                for k, item in enumerate(cast(list[Mapping[str, Any]], value)):
                    yield from _flat(item, f"{prefix}{name}.{item.get('name', k)}.")
            case _:
                yield f"{prefix}{name}", str(value)
