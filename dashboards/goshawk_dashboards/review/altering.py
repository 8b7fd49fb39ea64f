"""A flight planned again from an instant on, with another policy or other parameters."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self, cast

from goshawk_dashboards.charts.signals import Signals
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Replay

MARK = "altered: "
"""Before the name of a signal: the altered planner's."""
CHARTS = ("candidate flown", "cost flown", "thrust")
"""What is shown of an alteration, each over the flight's own."""
MOST_CHANGES = 20
LONGEST_S = 60.0


class AlterError(ValueError):
    """It cannot be planned again so; one line."""


@dataclass(frozen=True, kw_only=True)
class Alteration:
    """What is altered, and when."""

    from_s: float
    for_s: float
    changes: tuple[str, ...]
    """Such as "planner.costs.obstacle = 2"."""
    policy: str | None
    """By its name among those offered; None: the one that flew."""

    def __post_init__(self) -> None:
        """Raises AlterError for what takes too long."""
        if len(self.changes) > MOST_CHANGES:
            raise AlterError(f"{len(self.changes)} changes are too many: {MOST_CHANGES} at most")
        if not 0.0 < self.for_s <= LONGEST_S:
            raise AlterError(f"{self.for_s:g} s is no time to plan for: more than 0, {LONGEST_S:g} s at most")


class Replanner(Protocol):
    """Plans again."""

    @property
    def policies(self) -> tuple[str, ...]:
        """The names of those that may be chosen."""
        ...

    def replan(self, flight: Path, alteration: Alteration, out: Path) -> Mapping[str, Any]:
        """Writes what was planned to the new log ``out``; gives ``goshawk-air replay``'s figures.

        Raises AlterError.
        """
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Altered:
    """What came of an alteration, for one viewer."""

    words: str
    at_s: float
    """Of the first plan that was made again."""
    to_s: float
    replay: Replay
    """For the scene's thread."""
    signals: Signals
    """For the charts', by a handle of its own."""

    @classmethod
    def of(cls, replanner: Replanner, flight: Flight, asked: Alteration, out: Path) -> Self:
        """Plans again by way of the new log ``out``. Raises AlterError, or LogError for what was written."""
        figures = replanner.replan(flight.path, asked, out)
        try:
            scene, charts = (Flight.open(out, start_ns=flight.start_ns) for _ in range(2))
        finally:
            out.unlink(missing_ok=True)  # what is open stays readable
        return cls(
            words=str(figures["words"]),
            at_s=float(figures["from_s"]),
            to_s=float(figures["to_s"]),
            replay=Replay(scene),
            signals=Signals(charts),
        )


def parameters(tuning_toml: str) -> dict[str, str]:
    """The planner's parameters as they were flown, written as TOML has them."""
    try:
        planner = tomllib.loads(tuning_toml).get("planner", {})
    except tomllib.TOMLDecodeError:
        return {}
    return dict(_flat("planner", planner))


def _flat(name: str, value: Any) -> list[tuple[str, str]]:
    if isinstance(value, dict):
        table = cast(dict[str, Any], value)
        return [pair for key, inner in table.items() for pair in _flat(f"{name}.{key}", inner)]
    return [(name, str(value).lower() if isinstance(value, bool) else str(value))]
