"""The commands about flight logs: `report`, `logs`, `export`, `recover`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from goshawk_dashboards.exports import FOXGLOVE_LAYOUT, ExportError, Format, export_log
from goshawk_dashboards.log.flight import Flight, LogError
from goshawk_dashboards.log.recover import recover as recover_log
from goshawk_dashboards.report.summary import GOOD_OUTCOMES, Card, card
from rich.console import Console
from rich.progress import track
from rich.table import Table
from rich.text import Text

from goshawk_ground.commands.options import NO_REPLY, REFUSED, Json, LogFile, fail, open_flight, print_json

_HINTS = {
    Format.FOXGLOVE: f"open it in Foxglove or Lichtblick, with the layout {FOXGLOVE_LAYOUT}",
    Format.RERUN: "open it with: rerun {path}",
    Format.ROS2: "play it with: ros2 bag play -s mcap {path}",
    Format.CSV: "one file a channel, images beside them",
}


def report(
    log: LogFile,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="The page; default: beside the log.")] = None,
    figures: Annotated[Path | None, typer.Option(help="A folder for the figures as PNG and CSV.")] = None,
    against: Annotated[
        Path | None, typer.Option(help="The log whose parameters are compared; default: the one before, beside it.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a flight's report as one offline HTML page: why it ended so, charts, path, vibration, faults …"""
    # matplotlib takes a second
    from goshawk_dashboards.report.canvas import write
    from goshawk_dashboards.report.parameters import flight_before
    from goshawk_dashboards.report.report import make_report, write_page

    target = output or log.with_suffix(".html")
    if target.suffix.lower() != ".html":
        fail(f"{target} is no name for a page: let -o end in .html", NO_REPLY)
    try:
        with Console(stderr=True).status(f"reading {log}"):
            flight = open_flight(log)
            made = make_report(flight, flight_before(log) if against is None else open_flight(against))
            write_page(made, target)
            written = [] if figures is None else write(made.figures, figures)
    except OSError as error:
        fail(f"cannot write {error.filename or target}: {error.strerror}", NO_REPLY)
    if as_json:
        facts = {"flight": dataclasses.asdict(made.card), "numbers": dataclasses.asdict(made.numbers)}
        facts |= {"tracking": dataclasses.asdict(made.tracking), "why": made.why}
        print_json({"report": target, "figures": written, **facts})
        return
    typer.echo(f"{made.card.path.name}: {made.card.outcome}, {made.card.duration_s:.1f} s")
    for sentence in made.why:
        typer.echo(f"why: {sentence}")
    for fault in made.card.faults:
        typer.echo(f"fault: {fault}")
    if figures is not None:
        typer.echo(f"{figures}: {len(written)} files")
    typer.echo(f"{target}: open it in any browser")


def logs(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder of flight logs, with those below it.")] = Path(
        "logs"
    ),
    as_json: Json = False,
) -> None:
    """List flight logs with duration, outcome, faults and policy, the newest last. Exit status 1 if there is none."""
    if not folder.is_dir():
        fail(f"{folder} is no folder", NO_REPLY)
    cards, refused = _cards(folder)
    if not cards:
        fail(f"no flight log (.mcap) in {folder} or below it" + (f"; {refused[0]}" if refused else ""), REFUSED)
    cards.sort(key=lambda c: (c.wall_time or "", str(c.path)))
    if as_json:
        print_json({"flights": [dataclasses.asdict(c) for c in cards], "refused": refused})
        return
    table = Table("log", "began", "s", "outcome", "policy", "faults", box=None, pad_edge=False)
    for c in cards:
        began = (c.wall_time or "").replace("T", " ").partition(".")[0]
        policy = f"{c.task or '?'} {(c.policy_sha256 or 'unknown')[:8]}"
        name = Text(str(c.path.relative_to(folder)), overflow="fold")
        outcome = Text(c.outcome, style="green" if c.outcome in GOOD_OUTCOMES and not c.faults else "red")
        table.add_row(name, began, f"{c.duration_s:.1f}", outcome, policy, Text("; ".join(c.faults) or "-"))
    Console(highlight=False).print(table)
    for line in refused:
        typer.echo(f"goshawk: {line}", err=True)


def _cards(folder: Path) -> tuple[list[Card], list[str]]:
    """Each log's card, and a line for each file that is none."""
    cards: list[Card] = []
    refused: list[str] = []
    paths = sorted(folder.rglob("*.mcap"))
    for path in track(paths, "reading", console=Console(stderr=True), transient=True, disable=len(paths) < 2):
        try:
            cards.append(card(Flight.open(path)))
        except LogError as error:
            refused.append(str(error))
    return cards, refused


def export(
    log: LogFile,
    format: Annotated[Format, typer.Option(help="The tool to write for.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A new file (CSV: folder); default: beside the log.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a flight log for other tools: Foxglove and Lichtblick, Rerun, ROS 2, CSV. Exit status 2 if it cannot."""
    flight = open_flight(log)
    try:
        with Console(stderr=True).status(f"exporting {log}"):
            done = export_log(flight, format, output or log.with_name(log.stem + format.suffix))
    except ExportError as error:
        fail(str(error), NO_REPLY)
    if as_json:
        print_json(dataclasses.asdict(done))
        return
    width = max(map(len, done.counts), default=0)
    for name, count in sorted(done.counts.items()):
        typer.echo(f"{name:<{width}} {count:>8}")
    typer.echo(f"{done.path}: {_HINTS[format].format(path=done.path)}")


def recover(
    log: LogFile,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="A new file; default: beside the log.")] = None,
    as_json: Json = False,
) -> None:
    """Write all that can be read of a damaged or cut-off log as a clean one, and say which seconds are missing."""
    target = output or log.with_name(f"{log.stem}.recovered.mcap")
    try:
        done = recover_log(log, target)
    except LogError as error:
        fail(str(error), NO_REPLY)
    except OSError as error:
        fail(f"cannot write {target}: {error.strerror}", NO_REPLY)
    if as_json:
        print_json(dataclasses.asdict(done))
        return
    for missing in done.missing:
        typer.echo(f"damaged: {missing} missing")
    if not done.missing:
        typer.echo("nothing is damaged" if done.closed else "it was cut off; what was written is whole")
    typer.echo(f"{done.path}: {done.records} records of {done.duration_s:.1f} s")


def register(app: typer.Typer) -> None:
    """Adds the commands to the `goshawk` command."""
    app.command(
        epilog="Examples: goshawk report flight.mcap | goshawk report flight.mcap -o flight.html --figures figures"
    )(report)
    app.command(epilog="Examples: goshawk logs | goshawk logs logs/field --json | jq '.flights[].outcome'")(logs)
    app.command(
        epilog="Examples: goshawk export flight.mcap --format foxglove | goshawk export flight.mcap --format csv -o out"
    )(export)
    app.command(epilog="Examples: goshawk recover flight.mcap | goshawk recover flight.mcap -o clean.mcap")(recover)
