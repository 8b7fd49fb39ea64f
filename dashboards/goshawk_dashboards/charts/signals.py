"""All that a flight's log can show over time: every number of every channel, and what is derived of them.

A signal's name is a derived one, or a channel and a path: "control.vel_world.x", "plan.candidates.3.cost".
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from goshawk_dashboards.charts.curves import at
from goshawk_dashboards.charts.derived import DERIVED, Series
from goshawk_dashboards.log import numbers
from goshawk_dashboards.log.flight import CHANNELS, Flight
from goshawk_dashboards.page import theme

REPLAYED = "cost by the other policy"
TIMELESS = ("header", "world")
"""Channels with one record: nothing of them moves."""
SUFFIXES = {"_mps2": "m/s²", "_mps": "m/s", "_ms": "ms", "_ns": "ns", "_rad": "rad", "_deg": "°", "_hz": "Hz",
            "_m": "m", "_s": "s", "_n": "N", "_norm": "", "_fraction": ""}  # fmt: skip
VECTORS = {"ang_vel": "rad/s", "specific_force": "m/s²", "pos": "m", "vel": "m/s", "acc": "m/s²", "origin": "m"}
COLORS = (
    theme.VEHICLE, theme.TARGET, theme.GOOD, theme.DISTURBANCE, theme.SECOND, theme.REPLAY, theme.TRUTH, theme.BAD,
)  # fmt: skip
ACCELERATIONS = (
    "measured acceleration", "desired acceleration", "commanded acceleration", "disturbance", "true acceleration",
)  # fmt: skip
"""What is shown over each other along each axis."""


@dataclass(frozen=True, kw_only=True)
class Chart:
    """Signals over each other."""

    signals: tuple[str, ...]
    compared: int
    """How many of them, the first ones, are shown of several flights."""


CHARTS = (
    Chart(signals=("speed", "target speed"), compared=1),
    Chart(signals=("distance to target", "true distance to target"), compared=1),
    Chart(signals=("true clearance", "clearance by depth"), compared=1),
    Chart(signals=("cost flown", REPLAYED), compared=1),
    *(Chart(signals=tuple(f"{name} {axis}" for name in ACCELERATIONS), compared=1) for axis in ("east", "north", "up")),
    Chart(signals=("roll", "roll asked", "pitch", "pitch asked"), compared=1),
    Chart(signals=("thrust", "age of the plan"), compared=1),
)
"""What is shown before anybody has chosen."""


class Signals:
    """A flight's signals, read when asked for and kept. For one thread at a time."""

    def __init__(self, flight: Flight, known: Mapping[str, Series] | None = None) -> None:
        """``known`` is what was worked out elsewhere, and is shown under its name."""
        self._flight = flight
        self._read: dict[str, Series] = dict(known or {})
        self._known = tuple(self._read)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All that can be read; of the derived ones those whose channels were logged."""
        raw = [f"{c}.{path}" for c in CHANNELS if c not in TIMELESS for path in self._paths(c)]
        return (*dict.fromkeys((*DERIVED, *self._known)), *raw)

    def _paths(self, channel: str) -> Iterable[str]:
        count = self._flight.count(channel)
        some = sorted({0, count // 4, count // 2, 3 * count // 4, count - 1}) if count else []
        found = (self._flight.message(channel, k) for k in some)
        examples = [message for message in found if message is not None]
        return numbers.paths(CHANNELS[channel][1].DESCRIPTOR, examples) if examples else ()

    def at(self, name: str, time_s: float) -> float | None:
        """The newest value at a time of a signal that was read; None: it was not, there is none, or it is stale."""
        series = self._read.get(name)
        return None if series is None else at(*series, time_s)

    def read(self, names: Iterable[str]) -> dict[str, Series]:
        """Times and values of each; of a name that the log does not have none at all."""
        wanted = list(dict.fromkeys(names))
        by_channel: defaultdict[str, list[str]] = defaultdict(list)
        for name in wanted:
            if name in self._read:
                continue
            if name in DERIVED:
                self._read[name] = DERIVED[name].read(self._flight)
            elif name in self.names:
                channel, _, path = name.partition(".")
                by_channel[channel].append(path)
            else:
                self._read[name] = (np.zeros(0), np.zeros(0))
        for channel, paths in by_channel.items():
            columns = self._flight.columns(channel, paths)
            for path in paths:
                self._read[f"{channel}.{path}"] = (columns.times_s, columns[path].astype(np.float64))
        return {name: self._read[name] for name in wanted}


def unit_of(name: str) -> str:
    """What a signal is measured in; empty: a number, a count, a code."""
    if name in DERIVED:
        return DERIVED[name].unit
    parts = [part for part in name.split(".") if part not in "xyzw"]
    field = parts[-1]
    for suffix, unit in SUFFIXES.items():
        if field.endswith(suffix):
            return unit
    if field == "hz":
        return "Hz"
    return next((unit for prefix, unit in VECTORS.items() if prefix in field.removesuffix("_world")), "")


def looks_of(name: str, place: int) -> tuple[theme.Rgb, bool]:
    """The colour of a signal, the ``place``-th of its chart, and whether its line is dashed."""
    if name in DERIVED:
        return DERIVED[name].rgb, DERIVED[name].dashed
    if name == REPLAYED:
        return theme.REPLAY, False
    return COLORS[place % len(COLORS)], False
