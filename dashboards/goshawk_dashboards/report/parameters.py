"""What was flown with other parameters than the flight before: vehicle file, tuning file, policy, version."""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.log.flight import Flight, header_of
from goshawk_dashboards.log.recover import recovered_from

MOST_TRIED = 5
"""Logs of a folder, until one is of the same vehicle."""
MOST_LISTED, MOST_FOLDERS = 1000, 20
"""Of the folders beside a log's own so many are listed, and those looked into that are nearest to it in time."""
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
    """The newest log of the same vehicle that is older: beside the flight's, else in a folder beside its own.

    Beside it the name tells, as the vehicle names its logs; elsewhere the header's date, which simulated flights lack.
    A recovered log, or the one that it was made of, is no other flight.
    """
    path, now = flight.path, flight.header
    beside = (p for p in path.parent.glob("*.mcap") if p.name < path.name and p != recovered_from(path))
    for candidate in sorted(beside, reverse=True)[:MOST_TRIED]:
        header = header_of(candidate)
        if header is not None and header.vehicle == now.vehicle and not _one_flight(header, now):
            return Earlier(name=candidate.name, header=header)
    return _in_folders_beside(path.absolute(), now)


def _in_folders_beside(path: Path, now: pb.LogHeader) -> Earlier | None:
    """A demo's logs lie in a folder each."""
    began = _date(now)
    if began is None:
        return None
    found: list[tuple[datetime, Earlier]] = []
    for folder in _folders_beside(path):
        for log in sorted(folder.glob("*.mcap"), reverse=True)[:MOST_TRIED]:
            header = header_of(log)
            date = None if header is None else _date(header)
            if header is not None and date is not None and date < began and header.vehicle == now.vehicle:
                found.append((date, Earlier(name=f"{folder.name}/{log.name}", header=header)))
    return max(found, key=lambda pair: pair[0])[1] if found else None


def _folders_beside(path: Path) -> list[Path]:
    """Those that changed about when the log did."""
    try:
        written_ns = path.stat().st_mtime_ns
        listed = list(itertools.islice(path.parent.parent.iterdir(), MOST_LISTED))
        folders = [p for p in listed if p != path.parent and p.is_dir() and not p.is_symlink()]
        return sorted(folders, key=lambda p: abs(p.stat().st_mtime_ns - written_ns))[:MOST_FOLDERS]
    except OSError:
        return []


def _date(header: pb.LogHeader) -> datetime | None:
    """When a flight began; None: it has no date."""
    try:
        date = datetime.fromisoformat(header.wall_time)
    except ValueError:
        return None
    return date if date.tzinfo else date.replace(tzinfo=UTC)


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
