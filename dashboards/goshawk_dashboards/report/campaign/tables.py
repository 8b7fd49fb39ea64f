"""The numbers behind a campaign's pictures: a table for the page, and columns for CSV."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from html import escape
from typing import Any, cast

import numpy as np

from goshawk_dashboards.report import shell
from goshawk_dashboards.report.campaign.data import OUTCOMES, Campaign, Cell, MeanMax, Quantiles
from goshawk_dashboards.report.canvas import Table

NONE = "–"
_LISTS = ("flights", "modes", "target_plane")
"""What a line of CSV has no room for."""
_ENDS = {"success_interval": ("low", "high"), "end_pos_m": ("x", "y", "z")}


def number(value: float | None, digits: int = 2) -> str:
    """With a true minus, thousands set apart; a dash for none."""
    if value is None:
        return NONE
    text = f"{value:,.{digits}f}".replace(",", " ")
    # No minus before zero.
    return text.lstrip("-") if not text.strip("-0. ") else text.replace("-", "−")


def _row(*values: float | None, digits: int = 2, between: str = " / ") -> str:
    return NONE if all(v is None for v in values) else between.join(number(v, digits) for v in values)


def _mean_max(of: MeanMax | None) -> str:
    return NONE if of is None else _row(of.mean, of.max, digits=1)


def _range(of: Quantiles | None) -> str:
    return NONE if of is None else _row(of.p5, of.p95, between=" … ")


def _least(of: Quantiles | None) -> str:
    return NONE if of is None else _row(of.min, of.p1, of.p50)


def _hits(cell: Cell) -> str:
    return ", ".join(f"{what} {count}" for what, count in sorted(cell.contacts.items())) or NONE


Column = tuple[str, str, Callable[[Cell], str]]
_CELL: tuple[Column, ...] = (
    ("asked", "m/s", lambda c: f"{c.speed_mps:g}"),
    ("cruise", "m/s", lambda c: number(c.cruise_speed_mps, 1)),
    ("peak", "m/s", lambda c: number(c.peak_speed_mps, 1)),
    ("place", "", lambda c: c.place),
)
_ENDINGS: tuple[Column, ...] = (
    ("success", "", lambda c: f"{c.successes}/{c.trials}"),
    ("95 %", "interval, %", lambda c: _row(*(100.0 * x for x in c.success_interval), digits=0, between="–")),
    ("reached", "by the lax rule", lambda c: NONE if c.reached is None else f"{c.reached}/{c.trials}"),
    *((name.replace("-", " "), "flights", lambda c, name=name: str(c.count(name))) for name in OUTCOMES[1:]),
    ("touched", "flights", _hits),
)
_FLYING: tuple[Column, ...] = (
    ("closest approach", "min / 5 % / 50 %, m",
     lambda c: _row(c.clearance_m.min, c.clearance_m.p5, c.clearance_m.p50)),
    ("in view", "% of the time",
     lambda c: number(None if c.in_view_fraction is None else 100.0 * c.in_view_fraction, 0)),
    ("distance to target", "mean / max, m", lambda c: _mean_max(c.target_distance_m)),
    ("least distance to target", "min / 1 % / 50 %, m", lambda c: _least(c.min_distance_to_target_m)),
    ("lateral error", "5 … 95 %, m", lambda c: _range(c.target_error_m and c.target_error_m.lateral)),
    ("longitudinal error", "5 … 95 %, m", lambda c: _range(c.target_error_m and c.target_error_m.longitudinal)),
    ("∫ jerk²", "mean / 95 %, m²/s⁵",
     lambda c: _row(c.jerk_integral, c.jerk_integral_quantiles and c.jerk_integral_quantiles.p95, digits=0)),
    ("flown", "mean / max, m/s", lambda c: _mean_max(c.flown_speed_mps)),
)  # fmt: skip


def html(campaign: Campaign) -> str:
    """How each cell's flights ended, and how they flew: a line for each cell in two tables."""
    return _table(campaign, _ENDINGS) + _table(campaign, _FLYING)


def _table(campaign: Campaign, shown: tuple[Column, ...]) -> str:
    """Without the columns that no cell has."""
    columns = {name: (unit, [read(pool.cell) for pool in campaign.pools]) for name, unit, read in (*_CELL, *shown)}
    columns = {name: column for name, column in columns.items() if set(column[1]) != {NONE}}
    heads = ["cell", *(f"{escape(name)}<small>{escape(unit)}</small>" for name, (unit, _) in columns.items())]

    def row(place: int) -> Iterator[str]:
        yield f"<td class='number'>{campaign.pools[place].number}</td>"
        for name, (_, values) in columns.items():
            yield f"<td class='number {_tone(name, values[place])}'>{escape(values[place])}</td>"

    return shell.table(heads, (row(place) for place in range(len(campaign.pools))), "cells")


def _tone(name: str, value: str) -> str:
    if name == "success":
        return "main"
    if name.replace(" ", "-") in OUTCOMES:
        return "soft" if value == "0" else "bad"
    return ""


def cells_table(campaign: Campaign) -> Table:
    """A line for each cell."""
    return _columns(campaign.file.cells)


def flights_table(campaign: Campaign) -> Table:
    """A line for each flight."""
    pools = campaign.pools
    cells = {"cell": np.array([pool.number for pool in pools for _ in pool.cell.flights])}
    return cells | dict(_columns([flight for pool in pools for flight in pool.cell.flights]))


def _columns(rows: Iterable[Any]) -> Table:
    flat = [dict(_flat("", dataclasses.asdict(row))) for row in rows]
    names = dict.fromkeys(name for row in flat for name in row)
    return {name: np.array([row.get(name) for row in flat], dtype=object) for name in names}


def _flat(before: str, of: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Nested values by joined names: "clearance_m_p5"."""
    for key, value in of.items():
        name = f"{before}_{key}" if before else key
        if key in _LISTS:
            continue
        if isinstance(value, Mapping):
            yield from _flat(name, cast("Mapping[str, Any]", value))
        elif key in _ENDS:
            yield from ((f"{name}_{end}", part) for end, part in zip(_ENDS[key], value, strict=True))
        else:
            yield name, value
