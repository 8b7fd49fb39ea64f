"""A campaign from its plan to its cells: flies what is not finished, and makes one result of all."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import tempfile
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from goshawk_train.campaigns.flights import Row
from goshawk_train.cluster import plan as plans
from goshawk_train.cluster import table
from goshawk_train.cluster.engines import Engine, EngineError, Local
from goshawk_train.cluster.kit import Kit, temporary
from goshawk_train.cluster.plan import Campaign, Plan, PlanError, Unit
from goshawk_train.cluster.store import Store, StoreError
from goshawk_train.cluster.worker import PROGRAM, Processor, last_words

FILES = "simulator, policy, vehicle file, sensor file or world"


@dataclass(frozen=True, kw_only=True)
class Ready:
    """A plan with its kit."""

    plan: Plan
    kit: Kit
    campaigns: list[Campaign]
    units: list[Unit]

    @property
    def probe(self) -> list[str]:
        """The flight that all processors fly, to be compared: the plan's first."""
        return self.campaigns[0].one(0, 0)


@contextmanager
def ready(plan: Plan, simulator: Path, models: Path) -> Generator[Ready]:
    """Takes all files of a plan in; raises `TrainerError`s."""
    with temporary() as scratch:
        kit = Kit(simulator=simulator, scratch=Path(scratch))
        campaigns = plans.prepare(plan, kit, simulator, models)
        units = list(plans.units(campaigns, kit, plan.trials))
        yield Ready(plan=plan, kit=kit, campaigns=campaigns, units=units)


@contextmanager
def again(store: Store) -> Generator[Ready]:
    """A kept campaign with all its files as they were; raises `StoreError` if one is another now."""
    known = store.read_json("plan.json")
    try:
        listed, places = known["plan"], (Path(known["simulator"]), Path(known["models"]))
        rows = [Row(**row) for row in listed["rows"]]
        plan = Plan(rows=rows, trials=known["trials"], seed=listed["seed"], seeds=listed["seeds"])
    except (KeyError, TypeError) as error:
        raise StoreError(f"{store.url('plan.json')} is no file of a campaign of this version ({error})") from error
    with ready(plan, *places) as made:
        if made.kit.digest != known.get("kit_sha256"):
            raise StoreError(f"{store.address} was flown with another {FILES}: have those of then in place")
        yield made


def engine(name: str, made: Ready, workers: int | None, address: str | None) -> Engine:
    """The named one."""
    if name == "local":
        if address:
            raise EngineError("--address is a Ray cluster's: give --engine ray")
        return Local(made.kit, made.probe, workers)
    if address and workers:
        raise EngineError("--workers is for this machine: a cluster of --address has those that it has")
    from goshawk_train.cluster.on_ray import OnRay

    return OnRay(made.kit, made.probe, workers, address)


def fly(made: Ready, store: Store, begin_engine: Callable[[], Engine]) -> int:
    """Flies what is not finished; how many flights that were. Whatever stops it, what is finished is kept."""
    finished = store.names("units")
    missing = [unit for unit in made.units if f"{unit.name}.parquet" not in finished]
    total = sum(unit.flights for unit in made.units)
    left = sum(unit.flights for unit in missing)
    if not missing:
        return 0
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn("flights, {task.description}"), TimeElapsedColumn())
    with (
        closing(begin_engine()) as flying,
        Progress(*columns, TextColumn("left"), TimeRemainingColumn(), console=Console(stderr=True)) as progress,
    ):
        first = Processor(**store.read_json("processor.json")) if store.has("processor.json") else None
        shown, failed = progress.add_task("0 failed", total=total, completed=total - left), 0
        for unit, flown in flying.fly(missing):
            if first is None:
                first = flown.processor
                store.write_json("processor.json", dataclasses.asdict(first))
            same_processor(first, flown.processor)
            content = table.of_unit(unit, flown)
            store.write(f"units/{unit.name}.parquet", content)
            failed += table.failures(content)
            progress.update(shown, advance=unit.flights, description=f"{failed} failed")
    return left


def same_processor(first: Processor, found: Processor) -> None:
    """Refuses one that computes otherwise than the campaign's first; raises `EngineError`."""
    if first.flight_sha256 != found.flight_sha256:
        raise EngineError(
            f"two processors differ in floating point: {first} began this campaign, {found} flies the same flight "
            "otherwise; fly on one kind, or into another --out"
        )


def begin(made: Ready, store: Store, models: Path) -> None:
    """Says in the store what is flown; raises `StoreError` if flights of something else are there. Only trials may
    become more."""
    listed = json.loads(json.dumps(dataclasses.asdict(made.plan)))
    trials = listed.pop("trials")
    wanted = {"plan": listed, "kit_sha256": made.kit.digest}
    if store.has("plan.json") and store.names("units"):
        known = store.read_json("plan.json")
        if changed := [what for what in wanted if known.get(what) != wanted[what]]:
            what = "plan (only trials may change)" if "plan" in changed else FILES
            raise StoreError(f"{store.address} was flown with another {what}: give another --out")
    places = {"simulator": str(made.kit.simulator), "models": str(models)}
    store.write_json("plan.json", {**wanted, "trials": trials, **places})


def gather(made: Ready, store: Store) -> None:
    """Makes flights.parquet and the cells of each row, by the simulator's own code."""
    store.write("flights.parquet", table.parquet(table.flights(store, made.units)))
    with tempfile.TemporaryDirectory(prefix="goshawk-cells-") as folder:
        kit = made.kit.unpack(Path(folder) / "kit")
        for campaign in made.campaigns:
            lines, cells = Path(folder) / "records", Path(folder) / "cells.json"
            own = [unit for unit in made.units if unit.row == campaign.row.name]
            with lines.open("w") as out:
                out.writelines(f"{line}\n" for line in table.records(store, own))
            command = [kit / PROGRAM, *campaign.all_of(made.plan.trials), "--from", lines, "--json", cells]
            done = subprocess.run(command, cwd=kit, capture_output=True, text=True, check=False)
            if done.returncode:
                raise PlanError(f"{campaign.row.name}: {last_words(done.stderr, done.returncode)}")
            store.write(f"cells/{campaign.row.file(Path()).name}", cells.read_bytes())
