"""`goshawk campaign report` and `compare`: campaigns of the simulator as pages. They need no trainer, but to compare
what `goshawk campaign run` keeps."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from goshawk_ground.commands.options import NO_REPLY, Json, fail, print_json

KEPT = Path("ground/train/results")
README, RESULTS = Path("README.md"), KEPT.parent / "RESULTS.md"


def report(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE…",
            help="What goshawk-sim fly --json wrote; a page for each. Or the folder of a goshawk campaign run.",
        ),
    ],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of the pages; default: beside FILE.")] = None,
    figures: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="The figures too, as PNG and CSV: a folder for each FILE."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Draw campaigns as offline HTML pages: successes, distributions, failures, and maps of the flights."""
    # matplotlib takes a second
    from goshawk_dashboards.report.campaign.data import CampaignError, load
    from goshawk_dashboards.report.campaign.page import page
    from goshawk_dashboards.report.campaign.report import make_campaign_report
    from goshawk_dashboards.report.canvas import write

    files = [cells for file in files for cells in (sorted(file.glob("cells/*.json")) if file.is_dir() else [file])]
    if not files:
        fail("no cells are in there: goshawk campaign run makes them once all is flown", NO_REPLY)
    if len({file.stem for file in files}) < len(files) and (out or figures):
        fail("two of these files have one name: draw them one after the other, each into its own folder", NO_REPLY)
    facts = []
    for file in files:
        target = (out or file.parent) / f"{file.stem}.html"
        try:
            with Console(stderr=True).status(f"drawing {file}"):
                made = make_campaign_report(load(file))
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(page(made), encoding="utf-8")
                written = [] if figures is None else write(made.figures, figures / file.stem)
        except CampaignError as error:
            fail(str(error), NO_REPLY)
        except OSError as error:
            fail(f"cannot write {error.filename or target}: {error.strerror}", NO_REPLY)
        cells = made.campaign.file.cells
        successes, trials = sum(cell.successes for cell in cells), sum(cell.trials for cell in cells)
        facts.append({"file": file, "report": target, "figures": written, "successes": successes, "flights": trials})
        if not as_json:
            typer.echo(f"{file.name}: {successes} of {trials} flights succeeded")
            typer.echo(f"{target}: open it in any browser")
    if as_json:
        print_json({"campaigns": facts})


def compare(
    given: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE…",
            help="Campaigns that both pilots flew; default: the flight table's. Or two of goshawk campaign run, "
            "folders or s3://…, which are compared flight by flight.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(metavar="PAGE", help="The page.")] = Path("docs/learned-against-classical.html"),
    markdown: Annotated[
        Path | None,
        typer.Option(help=f"File whose marks get verdict and table; default, without FILE: {RESULTS}."),
    ] = None,
    readme: Annotated[
        Path | None, typer.Option(help=f"File whose marks get the verdict; default, without FILE: {README}.")
    ] = None,
    figures: Annotated[Path | None, typer.Option(metavar="DIR", help="The figures too, as PNG and CSV.")] = None,
    as_json: Json = False,
) -> None:
    """Say who flies better on the same seeds: the learned or the classical pilot, or one campaign or another."""
    if given and not any(name.endswith(".json") for name in given):
        return _flight_by_flight(given, as_json)
    from goshawk_dashboards.report.campaign.data import CampaignError
    from goshawk_dashboards.report.canvas import write
    from goshawk_dashboards.report.comparison import verdict as words
    from goshawk_dashboards.report.comparison.data import compare
    from goshawk_dashboards.report.comparison.figures import comparison_figures
    from goshawk_dashboards.report.comparison.page import page

    files = [Path(name) for name in given or ()]
    if not files:
        files, markdown, readme = (
            sorted(KEPT.glob("*.json"), key=lambda f: f.stem),
            markdown or RESULTS,
            readme or README,
        )
    try:
        with Console(stderr=True).status("comparing"):
            made = compare(files, strict=bool(given))
            drawn = comparison_figures(made)
            out.parent.mkdir(parents=True, exist_ok=True)
            out.write_text(page(made, drawn), encoding="utf-8")
            written = [] if figures is None else write(drawn, figures)
            for file, table in ((markdown, f"\n\n{words.markdown_table(made)}"), (readme, "")):
                if file is not None:
                    words.put(file, words.markdown(made, out, file) + table)
    except CampaignError as error:
        fail(str(error), NO_REPLY)
    except OSError as error:
        fail(f"cannot write {error.filename or out}: {error.strerror}", NO_REPLY)
    if made.skipped:
        typer.echo(f"goshawk: skipped {', '.join(made.skipped)}", err=True)
    head, rest = words.verdict(made)
    if as_json:
        scores = {s.metric.name: {"wins": s.learned, "loses": s.classical, "ties": s.tied} for s in made.scores}
        print_json({"verdict": head, "learned": scores, "page": out, "figures": written, "skipped": made.skipped})
    else:
        typer.echo(f"{head}. {rest}\n{out}: open it in any browser")
    return None


def _flight_by_flight(campaigns: list[str], as_json: bool) -> None:
    """Two campaigns of the trainer, which is found by name once it is needed."""
    if len(campaigns) != 2:
        fail("compare two campaigns: goshawk campaign compare A B, or the JSON files that both pilots flew", NO_REPLY)
    try:
        paired = importlib.import_module("goshawk_train.cluster.paired")
        store = importlib.import_module("goshawk_train.cluster.store")
        wrong = importlib.import_module("goshawk_train.errors").TrainerError
    except ModuleNotFoundError as error:
        fail(f"{error.name} is not installed: make setup-campaign", NO_REPLY)
    try:
        made = paired.compare(*(store.Store(campaign) for campaign in campaigns))
    except wrong as error:
        fail(str(error), NO_REPLY)
    if as_json:
        print_json({"a": campaigns[0], "b": campaigns[1], "cells": paired.facts(made)})
    else:
        typer.echo(paired.words(*campaigns, made))


def register(app: typer.Typer) -> None:
    """Adds the commands to `goshawk campaign`."""
    app.command(
        epilog="Examples: goshawk campaign report out.json | goshawk campaign report a.json b.json --out pages | "
        "goshawk campaign report out.json --figures figures | goshawk campaign report runs/campaign"
    )(report)
    app.command(
        epilog="Examples: goshawk campaign compare | goshawk campaign compare out.json --out page.html --figures out | "
        "goshawk campaign compare runs/without runs/with"
    )(compare)
