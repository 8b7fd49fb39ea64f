"""Writes what is whole of a damaged or cut-off log as a clean MCAP file, which every tool opens.

recovered = recover(Path("flight.mcap"), Path("flight.recovered.mcap"))
print(recovered.records, recovered.missing)
"""

from __future__ import annotations

import contextlib
import errno
import os
from dataclasses import dataclass
from pathlib import Path

from mcap.writer import CompressionType, Writer

from goshawk_dashboards.log.flight import Flight

SUFFIX = ".recovered.mcap"
"""What a name gets in place of the log's ".mcap"."""


@dataclass(frozen=True, kw_only=True)
class Recovered:
    """What was written."""

    path: Path
    records: int
    duration_s: float
    closed: bool
    """Whether the old log had its end; False: it was cut off, or its end is damaged."""
    missing: tuple[str, ...]
    """Which seconds the damage cost, a phrase each."""


def recover(log: Path, output: Path) -> Recovered:
    """Reads around what is damaged and keeps the order of writing, so that a replay can use it.

    Raises LogError if nothing can be read, OSError if the output exists or cannot be written.
    """
    if output.exists():
        raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(output))
    flight = Flight.open(log)
    # It gets its name at the end: what was broken off would stand in the way of another try.
    unfinished = output.with_name(f".{output.name}.unfinished")
    try:
        written = _copy(flight, unfinished)
        unfinished.rename(output)
    finally:
        with contextlib.suppress(OSError):
            unfinished.unlink()
    return Recovered(
        path=output, records=written, duration_s=flight.duration_s, closed=flight.closed, missing=flight.missing
    )


def recovered_from(path: Path) -> Path | None:
    """The log beside it that a recovered one, by its name, was made of; None: there is none."""
    log = path.with_name(path.name.removesuffix(SUFFIX) + ".mcap")
    return log if path.name.endswith(SUFFIX) and log.exists() else None


def _copy(flight: Flight, output: Path) -> int:
    """How many records."""
    written = 0
    with output.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(profile="", library="goshawk recover")
        ids: dict[int, int] = {}
        for channel, sequence, time_ns, payload in flight.log.records():
            if channel.id not in ids:
                schema = flight.log.schema_of(channel)
                name, encoding, data = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
                schema_id = writer.register_schema(name, encoding, data)
                ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            writer.add_message(ids[channel.id], time_ns, payload, time_ns, sequence)
            written += 1
        writer.finish()
    return written
