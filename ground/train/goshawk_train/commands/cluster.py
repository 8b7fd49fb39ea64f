"""`goshawk campaign run`, `query` and `worst`: campaigns beyond one machine. They need no torch."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from goshawk_train.commands.options import MODELS, SIMULATOR, Models, Simulator, Trials
from goshawk_train.commands.process import ends_in_one_line
from goshawk_train.errors import TrainerError

HERE = "runs/campaign"
Kept = Annotated[str, typer.Option("--campaign", metavar="DIR", help="Where it is kept: a folder, or s3://….")]


class EngineName(StrEnum):
    """Who flies."""

    LOCAL = "local"
    RAY = "ray"


def run(
    context: typer.Context,
    plan: Annotated[Path, typer.Argument(metavar="PLAN", help="Rows, speeds and trials, as flights.toml lists them.")],
    engine: Annotated[EngineName, typer.Option(help="The cores of this machine, or Ray.")] = EngineName.LOCAL,
    address: Annotated[
        str | None,
        typer.Option(metavar="ADDR", help="A Ray cluster that runs, such as auto; default: one of this machine."),
    ] = None,
    out: Annotated[str, typer.Option(metavar="DIR", help="Where it is kept: a folder, or s3://….")] = HERE,
    trials: Trials = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Flights at once here; default: as many as cores.")] = None,
    models: Models = MODELS,
    simulator: Simulator = SIMULATOR,
) -> None:
    """Fly a plan in small pieces, on this machine or on a Ray cluster; goes on where it stopped.

    Rates and their exact 95 % intervals are printed at the end. DIR/flights.parquet has a row for each flight.
    DIR/cells has what goshawk-sim fly --json would have written, for goshawk campaign report.
    """
    with _ends_in_one_line(context):
        from goshawk_train.cluster import plan as plans
        from goshawk_train.cluster import query
        from goshawk_train.cluster import run as campaign
        from goshawk_train.cluster.store import Store

        listed, store = plans.load(plan, trials), Store(out)
        with campaign.ready(listed, simulator, models) as made:
            campaign.begin(made, store, models)
            flown = campaign.fly(made, store, lambda: campaign.engine(engine, made, workers, address))
            campaign.gather(made, store)
        print(query.summary(store))
        print(f"{store.url('flights.parquet')}: {flown} flights flown now; goshawk campaign query asks it")


def query(
    context: typer.Context,
    question: Annotated[str, typer.Argument(metavar="SQL", help="Each flight is a row of the table flights.")],
    campaign: Kept = HERE,
    rows: Annotated[int, typer.Option(min=1, help="Show so many rows at most.")] = 1000,
) -> None:
    """Ask a flown campaign something in SQL, by DuckDB."""
    with _ends_in_one_line(context):
        from goshawk_train.cluster.query import ask
        from goshawk_train.cluster.store import Store

        ask(Store(campaign), question).show(max_rows=rows)


def worst(
    context: typer.Context,
    number: Annotated[int, typer.Option("-n", "--number", min=1, help="How many.")] = 20,
    campaign: Kept = HERE,
) -> None:
    """Fly the worst flights again with their logs, for goshawk review: collisions, other failures, then near misses."""
    with _ends_in_one_line(context):
        from goshawk_train.cluster import run as campaigns
        from goshawk_train.cluster import worst
        from goshawk_train.cluster.store import Store

        store = Store(campaign)
        with campaigns.again(store) as made:
            for flight in worst.fly(made, store, number):
                near = "" if flight.clearance_m is None else f", least clearance {flight.clearance_m:.2f} m"
                print(f"{flight.row} {flight.cell}:{flight.trial} {flight.ending}{near}: goshawk review {flight.log}")


@contextmanager
def _ends_in_one_line(context: typer.Context) -> Generator[None]:
    with ends_in_one_line(context):
        try:
            yield
        except ModuleNotFoundError as error:
            raise TrainerError(f"{error.name} is not installed: make setup-campaign") from error


def register(app: typer.Typer) -> None:
    """Adds them to the trainer's part of `goshawk campaign`."""
    app.command(
        epilog="Examples: goshawk campaign run ground/train/configs/night.toml | goshawk campaign run PLAN.toml "
        "--engine ray --address auto --out s3://bucket/night"
    )(run)
    app.command(
        epilog='Examples: goshawk campaign query "select outcome, count(*) from flights group by all" | goshawk '
        'campaign query "select seed, clearance_m from flights order by clearance_m limit 10" --campaign s3://bucket/night'
    )(query)
    app.command(epilog="Examples: goshawk campaign worst -n 20 | goshawk campaign worst -n 5 --campaign runs/night")(
        worst
    )
