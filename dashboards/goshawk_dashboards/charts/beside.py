"""The autopilot's own log of a flight on the flight's timeline: its signals by name, as the charts ask for them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from goshawk_dashboards.charts.curves import at
from goshawk_dashboards.log.beside import clock, files
from goshawk_dashboards.log.beside.files import BesideError
from goshawk_dashboards.log.beside.motion import Motion, Series
from goshawk_dashboards.log.flight import Flight

MARK = "beside: "
"""Before the name of a signal: the other log's."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Beside:
    """Another log with its clock fitted to a flight's."""

    path: Path
    clock: clock.Clock
    flaw: str
    signals: Mapping[str, Series]
    """By their own clock; "tilt" and "speed" are named like the flight's own."""

    @classmethod
    def open(cls, path: Path, flight: Flight) -> Beside:
        """Raises BesideError, one line, for what is no such log or whose clock does not fit the flight's."""
        told = files.read(path)
        try:
            fitted = clock.fit(motion_of(flight), told.motion)
        except clock.ClockError as error:
            raise BesideError(f"{path} does not lie beside {flight.path}: {error}") from error
        derived = {"tilt": told.motion.tilt_deg, "speed": told.motion.speed_mps}
        return cls(path=path, clock=fitted, flaw=told.flaw, signals=derived | dict(told.signals))

    @property
    def names(self) -> tuple[str, ...]:
        """All that can be read."""
        return tuple(self.signals)

    def read(self, names: Iterable[str]) -> dict[str, Series]:
        """Times by the flight's clock, and values; of a name that there is not none at all."""
        return {name: self._series(name) for name in names}

    def at(self, name: str, time_s: float) -> float | None:
        """The newest value at a time of the flight; None: there is none, or it is stale."""
        return at(*self._series(name), time_s)

    def _series(self, name: str) -> Series:
        if name not in self.signals:
            return np.zeros(0), np.zeros(0)
        times_s, values = self.signals[name]
        return self.clock.ours_s(times_s), values.astype(np.float64)

    @property
    def words(self) -> str:
        """How it lies, in a line."""
        return f"{self.path.name} lies beside: {self.clock.words}" + (f"; {self.flaw}" if self.flaw else "")


def motion_of(flight: Flight) -> Motion:
    """As its odometry tells it; as its controller was told, where no odometry was logged."""
    channel = "odometry" if flight.count("odometry") else "control"
    own = flight.columns(channel, ["world_from_body", "vel_world"])
    return Motion.of((own.times_s, own["world_from_body"]), (own.times_s, own["vel_world"]))
