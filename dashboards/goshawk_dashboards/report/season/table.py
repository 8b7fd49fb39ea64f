"""The flights of a folder as a table that SQL filters, sorts, groups and writes: DuckDB, in memory.

season = Season(rows)
season.keep("outcome = 'landed' AND clearance_m < 0.5")
season.sort("-duration")
for row in season.rows(): print(row["path"], row["clearance_m"])
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, cast

import duckdb

from goshawk_dashboards.report.season.row import Row, writable

_KINDS = {"str": "VARCHAR", "bool": "BOOLEAN", "int": "BIGINT", "float": "DOUBLE", "tuple[str, ...]": "VARCHAR[]"}
_COLUMNS = {
    field.name: "TIMESTAMP" if field.name == "began" else _KINDS[str(field.type).removesuffix(" | None")]
    for field in fields(Row)
}
ROWS_AT_ONCE = 500
BY_DATE = "began NULLS FIRST, path"


class SeasonError(ValueError):
    """What was asked for cannot be had: one line that says what to do."""


def _value(value: object) -> object:
    """As DuckDB takes it."""
    if isinstance(value, tuple):
        return [writable(text) for text in cast("tuple[str, ...]", value)]
    return writable(value) if isinstance(value, str) else value


class Season:
    """The table ``flights``: a row a log, the columns of ``Row``."""

    def __init__(self, rows: Iterable[Row]) -> None:
        # What an expression names is in memory: nothing is fetched from anywhere to understand it.
        self._db = duckdb.connect(config={"autoinstall_known_extensions": "false"})
        columns = ", ".join(f"{name} {kind}" for name, kind in _COLUMNS.items())
        self._db.execute(f"CREATE TABLE flights ({columns})")
        one = f"({', '.join('?' * len(_COLUMNS))})"
        left = iter(rows)
        # Many at once: a statement a row takes a second for a thousand.
        while some := list(itertools.islice(left, ROWS_AT_ONCE)):
            values = [_value(getattr(row, name)) for row in some for name in _COLUMNS]
            self._db.execute(f"INSERT INTO flights VALUES {', '.join([one] * len(some))}", values)
        self._order = BY_DATE

    def keep(self, where: str) -> None:
        """Only the flights for which an SQL expression holds. Raises SeasonError."""
        try:
            self._db.execute(f"DELETE FROM flights WHERE ({where}\n) IS NOT TRUE")
        except duckdb.Error as error:
            why = str(error).splitlines()[0].rstrip("!")
            raise SeasonError(f"--where {where}: {why}; the columns are {', '.join(_COLUMNS)}") from error

    def sort(self, column: str) -> None:
        """By a column, or by the first that begins so; a minus before it: the greatest first. Raises SeasonError."""
        down, name = column.startswith("-"), column.removeprefix("-")
        name = "fault_count" if name == "faults" else name
        fitting = [name] if name in _COLUMNS else [known for known in _COLUMNS if known.startswith(name)]
        if not fitting:
            raise SeasonError(f"--sort {column} is no column: {', '.join(_COLUMNS)}")
        self._order = f"{fitting[0]} {'DESC' if down else 'ASC'} NULLS LAST, path"

    def rows(self, order: str = "") -> list[dict[str, Any]]:
        """The flights, each by its columns, in an order of ours, else in the one that was asked for."""
        return self.ask(f"SELECT * FROM flights ORDER BY {order or self._order}")

    def ask(self, query: str, values: Sequence[object] = ()) -> list[dict[str, Any]]:
        """A query of our own, its rows by their columns."""
        self._db.execute(query, list(values))
        names = [column[0] for column in self._db.description or ()]
        return [dict(zip(names, row, strict=True)) for row in self._db.fetchall()]

    def write_parquet(self, output: Path) -> None:
        """The flights in order as a Parquet file, which replaces one that is there. Raises SeasonError."""
        try:
            self._db.sql(f"SELECT * FROM flights ORDER BY {self._order}").write_parquet(str(output))
        except duckdb.Error as error:
            raise SeasonError(f"cannot write {output}: {str(error).splitlines()[0]}") from error


def wrong(flight: dict[str, Any]) -> list[str]:
    """What was wrong with log and flight, a phrase each; not what its outcome says already."""
    return [told for told in (flight["damage"], *flight["faults"]) if told not in (None, flight["outcome"])]
