"""Flights as Parquet, a row each: which it was, what came of it, and what it was flown with."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pyarrow
import pyarrow.parquet

from goshawk_train.cluster.plan import Unit
from goshawk_train.cluster.store import Store, StoreError
from goshawk_train.cluster.worker import Flown

pa: Any = pyarrow
pq: Any = pyarrow.parquet  # neither comes with types
TEXT: Any = pa.string()
WHOLE: Any = pa.int32()
NUMBER: Any = pa.float64()
YES: Any = pa.bool_()
HEAD: dict[str, Any] = {
    "cell": WHOLE, "trial": WHOLE, "seed": pa.uint64(), "pilot": TEXT, "task": TEXT, "speed_mps": NUMBER,
    "spacing_m": NUMBER, "world": TEXT, "evader": TEXT, "course": TEXT, "length_m": NUMBER, "wind_mps": NUMBER,
    "moving": WHOLE, "conditions_sha256": TEXT, "policy_sha256": TEXT, "vehicle_sha256": TEXT,
    "flight_code_sha256": TEXT,
}  # fmt: skip
"""As the simulator's records name them."""
SUMMARY: dict[str, Any] = {
    "outcome": TEXT, "reached": YES, "contact": TEXT, "flown_s": NUMBER, "task_s": NUMBER,
    "end_pos_m": pa.list_(NUMBER), "end_distance_m": NUMBER, "unseen_s": NUMBER, "clearance_m": NUMBER,
    "in_view_fraction": NUMBER, "target_distance_mean_m": NUMBER, "target_distance_max_m": NUMBER,
    "min_distance_to_target_m": NUMBER, "jerk_integral": NUMBER, "flown_speed_mean_mps": NUMBER,
    "flown_speed_max_mps": NUMBER, "cruise_speed_mps": NUMBER, "far_s": NUMBER, "modes": pa.list_(TEXT),
}  # fmt: skip
OURS: dict[str, Any] = {
    "row": TEXT,
    "success": YES,
    "unit": TEXT,
    "core_s": NUMBER,
    "node": TEXT,
    "processor": TEXT,
}
"""The plan's row, and what flying it took: a unit's seconds of one core, shared among its flights."""
FLIGHTS: Any = pa.schema({**OURS, **HEAD, **SUMMARY})
UNIT: Any = FLIGHTS.append(pa.field("record", TEXT))
"""The record is the simulator's own line, from which cells are made bit for bit."""


def parquet(table: Any) -> bytes:
    """The file's content."""
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, compression="zstd")
    return sink.getvalue().to_pybytes()


def of_unit(unit: Unit, flown: Flown) -> bytes:
    """A unit's file; raises `StoreError` if not all of its flights are in it."""
    lines = flown.records.decode().splitlines()
    rows = [_row(unit, flown, line, len(lines)) for line in lines]
    if [(row["cell"], row["trial"]) for row in rows] != [(unit.cell, unit.first + n) for n in range(unit.flights)]:
        raise StoreError(f"{unit.row}: the simulator flew something else than {' '.join(unit.arguments)}")
    return parquet(pa.Table.from_pylist(rows, schema=UNIT))


def _row(unit: Unit, flown: Flown, line: str, flights: int) -> dict[str, Any]:
    read = json.loads(line)
    head, summary = read["head"], read["summary"]
    for name, unit_of_it in (("target_distance", "m"), ("flown_speed", "mps")):
        both = summary.pop(f"{name}_{unit_of_it}") or {"mean": None, "max": None}
        summary |= {f"{name}_{which}_{unit_of_it}": value for which, value in both.items()}
    ours = {
        "row": unit.row, "unit": unit.name, "success": summary["outcome"] == "success",
        "core_s": flown.seconds / flights, "node": flown.processor.node, "processor": flown.processor.model,
    }  # fmt: skip
    return {**ours, **head, **summary, "record": line}


def failures(content: bytes) -> int:
    """How many flights of a unit's file did not succeed."""
    flown = pq.read_table(pa.BufferReader(content), columns=["success"])["success"].to_pylist()
    return flown.count(False)


def read(store: Store, name: str, columns: list[str] | None = None) -> Any:
    """A file's flights; raises `StoreError`."""
    content = store.read(name)
    try:
        return pq.read_table(pa.BufferReader(content), columns=columns)
    except (pa.ArrowInvalid, OSError) as error:
        raise StoreError(f"{store.url(name)} is damaged: remove it, and run the campaign again ({error})") from error


def read_unit(store: Store, unit: str, columns: list[str]) -> Any:
    """The flights of a finished unit of that name; raises `StoreError`."""
    return read(store, f"units/{unit}.parquet", columns)


def records(store: Store, units: list[Unit]) -> Iterator[str]:
    """The simulator's lines of all flights."""
    for unit in units:
        yield from read_unit(store, unit.name, ["record"])["record"].to_pylist()


def flights(store: Store, units: list[Unit]) -> Any:
    """All flights, in the plan's order."""
    parts = [read_unit(store, unit.name, FLIGHTS.names) for unit in units]
    return pa.concat_tables(parts).sort_by([(name, "ascending") for name in ("row", "cell", "trial")])
