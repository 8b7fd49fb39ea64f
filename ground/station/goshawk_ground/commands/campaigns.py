"""`goshawk campaign report`: a campaign of the simulator as a page. It needs no trainer."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from goshawk_ground.commands.options import NO_REPLY, Json, fail, print_json


def report(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE…", help="What goshawk-sim fly --json wrote; a page for each.")
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


def register(app: typer.Typer) -> None:
    """Adds the command to `goshawk campaign`."""
    app.command(
        epilog="Examples: goshawk campaign report out.json | goshawk campaign report a.json b.json --out pages | "
        "goshawk campaign report out.json --figures figures"
    )(report)
