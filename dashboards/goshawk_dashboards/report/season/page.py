"""The page of a folder of flights: sums, trends, vehicles and policies, faults, and each flight."""

from __future__ import annotations

import os
import re
import shlex
from collections.abc import Iterable, Iterator
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from goshawk_dashboards.report.season.figures import Flights, figures, narrow
from goshawk_dashboards.report.season.row import writable
from goshawk_dashboards.report.season.table import BY_DATE, Season, wrong
from goshawk_dashboards.report.shell import document, panel, table, tiles

ABSENT = "–"
WORDS = "<span>{}</span>".format
"""The head of a column of words, which stands at the left."""
_SUMS = """
SELECT count(*) AS flights, count(*) FILTER (good) AS good, sum(duration_s) AS duration_s, sum(path_m) AS path_m,
  min(clearance_m) AS clearance_m, sum(fault_count) AS faults, strftime(min(began), '%Y-%m-%d') AS first,
  strftime(max(began), '%Y-%m-%d') AS last
FROM flights
"""
_KINDS = """
SELECT vehicle, policy, task, count(*) AS flights, count(*) FILTER (good) AS good, sum(duration_s) / 60 AS minutes,
  median(clearance_m) AS clearance_m, min(clearance_m) AS least_m, median(disturbance_mps2) AS disturbance_mps2,
  avg(fault_count) AS faults
FROM flights GROUP BY ALL ORDER BY flights DESC, vehicle, policy, task
"""
_FAULTS = """
SELECT regexp_replace(fault, ' \\(\\d+ times\\)$', '') AS told, count(DISTINCT path) AS flights, max(path) AS path
FROM (SELECT path, unnest(faults) AS fault FROM flights) GROUP BY told ORDER BY flights DESC, told
"""


def page(season: Season, folder: Path, beside: Path) -> str:
    """The whole page, which will lie in the folder ``beside``; the flights by date."""
    flights = season.rows(BY_DATE)
    (sums,) = season.ask(_SUMS)
    parts = [
        _head(folder, sums),
        tiles(_tiles(sums)),
        *(panel(figure, narrow=narrow(figure)) for figure in figures(flights)),
        _kinds(season),
        _faults(season, folder),
        _flights(flights, folder, beside),
    ]
    return document(f"Flights of {folder}", parts)


def _head(folder: Path, sums: dict[str, Any]) -> str:
    when = f"{sums['first']} to {sums['last']}" if sums["first"] else "simulated, without a date"
    return f"<header><h1>Flights of {escape(str(folder))}</h1><p class='soft'>{when}</p></header>"


def _tiles(sums: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    yield "flights", str(sums["flights"]), ""
    yield "ended well, without a fault", f"{100.0 * sums['good'] / sums['flights']:.0f}", "%"
    yield "in all", _number((sums["duration_s"] or 0.0) / 60.0, 1), "min"
    yield "flown", _number((sums["path_m"] or 0.0) / 1000.0, 2), "km"
    yield "least clearance", _number(sums["clearance_m"], 2), "m"
    yield "faults", _number(sums["faults"], 0), ""


def _kinds(season: Season) -> str:
    heads = (*map(WORDS, ("vehicle", "policy", "task")), "flights", "good", "min", "clearance<small>median, m</small>",
             "clearance<small>least, m</small>", "disturbance<small>median, m/s²</small>",
             "faults<small>a flight</small>")  # fmt: skip

    def row(of: dict[str, Any]) -> Iterator[str]:
        yield from (f"<td>{escape(of[name] or ABSENT)}</td>" for name in ("vehicle", "policy", "task"))
        yield from (f"<td class='number'>{of[name]}</td>" for name in ("flights", "good"))
        digits = {"minutes": 1, "clearance_m": 2, "least_m": 2, "disturbance_mps2": 2, "faults": 1}
        yield from (f"<td class='number'>{_number(of[name], n)}</td>" for name, n in digits.items())

    body = _table(heads, (row(of) for of in season.ask(_KINDS)))
    return f"<section class='panel'><h2>Vehicles and policies</h2>{body}</section>"


def _faults(season: Season, folder: Path) -> str:
    found = season.ask(_FAULTS)
    if not found:
        return "<section class='panel'><h2>Faults</h2><p class='soft'>None was logged.</p></section>"

    def row(of: dict[str, Any]) -> Iterator[str]:
        yield f"<td>{escape(of['told'])}</td>"
        yield f"<td class='number'>{of['flights']}</td>"
        yield f"<td>{escape(_name(of['path'], folder))}</td>"

    body = _table((WORDS("fault"), "flights", WORDS("the last by name")), (row(of) for of in found))
    return f"<section class='panel'><h2>Faults</h2>{body}</section>"


def _flights(flights: Flights, folder: Path, beside: Path) -> str:
    heads = ("flight", WORDS("log"), WORDS("outcome"), "s", "clearance, m", "disturbance, m/s²", WORDS("faults"),
             WORDS("look at it"))  # fmt: skip

    def row(number: int, of: dict[str, Any]) -> Iterator[str]:
        path = Path(of["path"])
        name = escape(_name(of["path"], folder))
        report = path.with_suffix(".html")
        yield f"<td class='number'>{number}</td>"
        yield f"<td>{_link(report, beside, name) if report.is_file() else name}</td>"
        yield f"<td class='{'good' if of['good'] else 'bad'}'>{escape(of['outcome'])}</td>"
        digits = {"duration_s": 1, "clearance_m": 2, "disturbance_mps2": 2}
        yield from (f"<td class='number'>{_number(of[column], n)}</td>" for column, n in digits.items())
        yield f"<td>{escape('; '.join(wrong(of)) or ABSENT)}</td>"
        yield f"<td><code>goshawk review {escape(shlex.quote(of['path']))}</code></td>"

    note = "The name of a flight leads to its report, where one lies beside its log: <code>goshawk report LOG</code>."
    body = _table(heads, (row(k, of) for k, of in enumerate(flights, 1)))
    return f"<section class='panel'><h2>Flights</h2><p class='soft'>{note}</p>{body}</section>"


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """On a phone each row is a list, and each cell tells the name of its column."""
    heads = list(heads)
    names = [" ".join(re.sub(r"<[^>]+>", " ", head).split()) for head in heads]
    named = (
        [cell.replace("<td", f"<td data-name='{name}'", 1) for name, cell in zip(names, row, strict=True)]
        for row in rows
    )
    return table(heads, named, "season")


def _name(path: str, folder: Path) -> str:
    return str(Path(path).relative_to(writable(str(folder))))


def _link(to: Path, beside: Path, name: str) -> str:
    return f"<a href='{quote(os.path.relpath(to, beside))}'>{name}</a>"


def _number(value: float | None, digits: int) -> str:
    return ABSENT if value is None else f"{value:.{digits}f}".replace("-", "−")
