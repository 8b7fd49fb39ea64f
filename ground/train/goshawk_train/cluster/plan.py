"""A plan: the flight table's rows, cut into small units that are flown in any order, anywhere.

A unit is a few flights of one cell. Its name is the hash of everything that decides them, so that one that was flown
once is never flown again, whoever asks for it.
"""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from goshawk_train.campaigns.flights import Row, present, read_rows, refuse_unknown, whole
from goshawk_train.cluster.kit import Kit
from goshawk_train.errors import TrainerError

FLIGHTS_PER_UNIT = 5
"""A chase takes about a second of one core: a unit takes some seconds, and no more is lost if its machine is."""
FIRMWARE = ("--firmware", "--autopilot")


class PlanError(TrainerError):
    """The plan cannot be flown; the message says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What is flown."""

    rows: list[Row]
    trials: int
    seed: int | None
    """None: each row's comes of its hashes, as in the flight table."""
    seeds: str
    """The range that a given seed is of: "table", or "tuning"."""


@dataclass(frozen=True, kw_only=True)
class Unit:
    """Some flights of one cell."""

    name: str
    """The hash."""
    row: str
    cell: int
    first: int
    """Its first trial."""
    flights: int
    arguments: list[str]
    """Of the simulator, in the kit's folder."""


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A row, ready to be cut: its arguments in the kit, and how many cells it has."""

    row: Row
    arguments: list[str]
    """Without --trials."""
    cells: int

    def all_of(self, trials: int) -> list[str]:
        """The arguments of the whole of it."""
        return [*self.arguments, "--trials", str(trials)]

    def one(self, cell: int, trial: int) -> list[str]:
        """The arguments of one flight."""
        return [*self.all_of(trial + 1), "--only", f"{cell}:{trial}"]


def load(path: Path, trials: int | None = None) -> Plan:
    """The plan in a TOML file, with another number of trials if one is given; raises `PlanError`."""
    try:
        table = tomllib.loads(path.read_text())
        refuse_unknown(table, {"row", "trials", "seed", "seeds"})
        rows, each = read_rows(table["row"]), whole(table, "trials")
        seed = whole(table, "seed", 0) if "seed" in table else None
        plan = Plan(rows=rows, trials=trials or each, seed=seed, seeds=table.get("seeds", "table"))
        if plan.seeds not in ("table", "tuning"):
            raise ValueError(f"seeds must be table or tuning, not {plan.seeds!r}")
    except (OSError, tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise PlanError(f"{path} is no plan: {error}; ground/train/configs/flights.toml is one") from error
    if not rows:
        raise PlanError(f"{path} has nothing to fly: it needs a row")
    if flown := [row.name for row in rows if any(option in FIRMWARE for option in row.options)]:
        raise PlanError(f"{', '.join(flown)}: firmware flies with goshawk-sim fly only, one flight after the other")
    return plan


def prepare(plan: Plan, kit: Kit, simulator: Path, models: Path) -> list[Campaign]:
    """Its rows, with all their files in the kit."""
    return [_campaign(plan, row, kit, simulator, models) for row in plan.rows]


def _campaign(plan: Plan, row: Row, kit: Kit, simulator: Path, models: Path) -> Campaign:
    seed = plan.seed
    if seed is None:
        seed = present(simulator, row.policy(models), row.vehicle)["table_seed"]
    _, *arguments = row.with_policy(row.arguments(1, seed), models)
    at = arguments.index("--trials")
    del arguments[at : at + 2]
    if row.scan:
        arguments += ["--world", kit.scan(row.scan, seed)]
    if "--vehicle-file" not in arguments:
        arguments += ["--vehicle-file", row.vehicle]
    arguments = ["fly", "--seeds", plan.seeds, *kit.take(arguments)]
    return Campaign(row=row, arguments=arguments, cells=row.cells)


def units(campaigns: list[Campaign], kit: Kit, trials: int, flights: int = FLIGHTS_PER_UNIT) -> Iterator[Unit]:
    """All units, the first flights of all cells first: a stopped campaign has some of everything."""
    for first in range(0, trials, flights):
        for campaign in campaigns:
            for cell in range(campaign.cells):
                some = range(first, min(first + flights, trials))
                only = ",".join(f"{cell}:{trial}" for trial in some)
                arguments = [*campaign.all_of(some.stop), "--only", only]
                # The kit's names of files are hashes of what is in them.
                decides = json.dumps([kit.program_sha256, arguments])
                name = hashlib.sha256(decides.encode()).hexdigest()
                yield Unit(
                    name=name, row=campaign.row.name, cell=cell, first=first, flights=len(some), arguments=arguments
                )
