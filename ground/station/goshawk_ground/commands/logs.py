"""The commands about flight logs: `report`, `logs`, `export`, `recover`."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path
from typing import Annotated, Any

import typer
from goshawk_dashboards.exports import FOXGLOVE_LAYOUT, ExportError, Format, export_log
from goshawk_dashboards.log.flight import LogError
from goshawk_dashboards.log.progress import progress_bar
from goshawk_dashboards.log.recover import SUFFIX, recovered_from
from goshawk_dashboards.log.recover import recover as recover_log
from rich.console import Console
from rich.table import Table
from rich.text import Text

from goshawk_ground.commands.options import (
    NO_REPLY,
    REFUSED,
    Json,
    LogFile,
    fail,
    open_flight,
    print_json,
    say,
    visible,
)

_HINTS = {
    Format.FOXGLOVE: f"open it in Foxglove or Lichtblick, with the layout {FOXGLOVE_LAYOUT}",
    Format.RERUN: "open it with: rerun {path}",
    Format.ROS2: "play it with: ros2 bag play -s mcap {path}",
    Format.CSV: "one file a channel, images beside them",
}
OTHERS_WIDTH, OUTCOME_WIDTH = 46, 17
"""Columns of all but a log's name, and of the longest outcome: 34 are left for a name in a table of 80."""
LEAST_NAME_WIDTH = 20


def cache_folder() -> Path:
    """Where a user's programs keep what can be worked out again."""
    return Path(os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "goshawk"


def report(
    log: LogFile,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="The page; default: beside the log.")] = None,
    figures: Annotated[Path | None, typer.Option(help="A folder for the figures as PNG and CSV.")] = None,
    against: Annotated[
        Path | None,
        typer.Option(
            help="The log whose parameters are compared; default: the one before, in its folder or in one beside that."
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a flight's report as one offline HTML page: why it ended so, charts, path, vibration, faults …"""
    # matplotlib takes a second
    from goshawk_dashboards.report.canvas import write
    from goshawk_dashboards.report.parameters import Earlier, flight_before
    from goshawk_dashboards.report.report import make_report, write_page

    target = output or log.with_suffix(".html")
    if target.suffix.lower() != ".html":
        fail(f"{target} is no name for a page: let -o end in .html", NO_REPLY)
    try:
        with progress_bar(counted=False) as progress:
            flight = open_flight(log, progress)
            if against is None:
                before = flight_before(flight)
            else:
                before = Earlier(name=against.name, header=open_flight(against).header)
            made = make_report(flight, before, progress)
            write_page(made, target)
            written = [] if figures is None else write(made.figures, figures)
    except OSError as error:
        fail(f"cannot write {error.filename or target}: {error.strerror}", NO_REPLY)
    if as_json:
        facts = {"flight": dataclasses.asdict(made.card), "numbers": dataclasses.asdict(made.numbers)}
        facts |= {"tracking": dataclasses.asdict(made.tracking), "why": made.why}
        print_json({"report": target, "figures": written, **facts})
        return
    say(f"{made.card.path.name}: {made.card.outcome}, {made.card.duration_s:.1f} s")
    for sentence in made.why:
        say(f"why: {sentence}")
    for fault in made.card.faults:
        say(f"fault: {fault}")
    if figures is not None:
        say(f"{figures}: {len(written)} files")
    say(f"{target}: open it in any browser")


def logs(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder of flight logs, with those below it.")] = Path(
        "logs"
    ),
    sort: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Such as duration, clearance, faults; -clearance: greatest first; absent: by date."
        ),
    ] = None,
    where: Annotated[
        str | None, typer.Option(metavar="SQL", help="Only flights for which it holds: \"outcome = 'landed'\".")
    ] = None,
    parquet: Annotated[Path | None, typer.Option(metavar="FILE", help="Write the table as a Parquet file.")] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write one offline HTML page over these flights, by date.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List flight logs, the newest last; sort, filter, export; draw what changed from flight to flight. Exit status 1
    if there is none.

    A log is read once: what it says is kept in your cache until the log changes.
    """
    # DuckDB takes a tenth of a second, which no Stop shall wait for
    from goshawk_dashboards.report.season.gather import gather
    from goshawk_dashboards.report.season.table import Season, SeasonError

    if not folder.is_dir():
        fail(f"{folder} is no folder", NO_REPLY)
    if report is not None and report.suffix.lower() != ".html":
        fail(f"{report} is no name for a page: let --report end in .html", NO_REPLY)
    if parquet is not None and parquet.suffix.lower() != ".parquet":
        fail(f"{parquet} is no name for a table: let --parquet end in .parquet", NO_REPLY)
    # A recovered log is the same flight, and does not say what is missing.
    paths = sorted(path for path in folder.rglob("*.mcap") if recovered_from(path) is None)
    screen = Console(stderr=True)
    with progress_bar(counted=False) as progress:
        season = Season(row for row in gather(paths, cache_folder(), progress) if row is not None)
    try:
        if where is not None:
            season.keep(where)
        if sort is not None:
            season.sort(sort)
        flights = season.rows()
        if not flights:
            fail(f"no flight in {folder} or below it" + (f" for which {where}" if where else ""), REFUSED)
        if parquet is not None:
            season.write_parquet(parquet)
    except SeasonError as error:
        fail(str(error), NO_REPLY)
    if report is not None:
        # matplotlib takes a second
        from goshawk_dashboards.report.season.page import page

        with screen.status(f"drawing {report}"):
            text = page(season, folder, report.parent)
        try:
            report.write_text(text, encoding="utf-8", errors="backslashreplace")
        except OSError as error:
            fail(f"cannot write {report}: {error.strerror}", NO_REPLY)
    if as_json:
        print_json({"flights": flights})
        return
    _print_flights(flights, folder)
    for written, hint in ((parquet, "open it with DuckDB, pandas or Polars"), (report, "open it in any browser")):
        if written is not None:
            say(f"{written}: {hint}")


def _print_flights(flights: list[dict[str, Any]], folder: Path) -> None:
    """A line a flight where there are 80 columns; what went wrong as far as there is room."""
    from goshawk_dashboards.report.season.row import writable
    from goshawk_dashboards.report.season.table import wrong

    names = [visible(str(Path(f["path"]).relative_to(writable(str(folder))))) for f in flights]
    console = Console(highlight=False)
    table = Table(box=None, pad_edge=False, expand=True)
    width = min(max(map(len, names)), max(LEAST_NAME_WIDTH, console.width - OTHERS_WIDTH))
    table.add_column("log", overflow="ellipsis", no_wrap=True, width=width)
    for head in ("s", "near m", "m/s²"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("outcome", max_width=OUTCOME_WIDTH, overflow="ellipsis", no_wrap=True)
    table.add_column("wrong", overflow="ellipsis", no_wrap=True, ratio=1)
    for name, f in zip(names, flights, strict=True):
        told = [visible(text) for text in wrong(f)]
        table.add_row(
            Text(shortened(name, width)),
            *(
                "-" if f[column] is None else f"{f[column]:.{digits}f}"
                for column, digits in (("duration_s", 1), ("clearance_m", 2), ("disturbance_mps2", 2))
            ),
            Text(visible(f["outcome"]), style="green" if f["good"] else "red"),
            Text(f"{len(told)}: {'; '.join(told)}" if len(told) > 1 else "".join(told) or "-"),
        )
    console.print(table)


def shortened(name: str, width: int) -> str:
    """Without its middle if it is too long: a folder's name begins, and a log's ends, with what tells it apart."""
    if len(name) <= width:
        return name
    tail = (width - 1) // 2
    return f"{name[: width - 1 - tail]}…{name[-tail:]}"


def export(
    log: LogFile,
    format: Annotated[Format, typer.Option(help="The tool to write for.")],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="A new file (CSV: folder); default: beside the log.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a flight log for other tools: Foxglove and Lichtblick, Rerun, ROS 2, CSV. Exit status 2 if it cannot."""
    with progress_bar(counted=False) as progress:
        flight = open_flight(log, progress)
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
        say(f"{name:<{width}} {count:>8}")
    say(f"{done.path}: {_HINTS[format].format(path=done.path)}")


def recover(
    log: LogFile,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="A new file; default: beside the log.")] = None,
    as_json: Json = False,
) -> None:
    """Write all that can be read of a damaged or cut-off log as a clean one, and say which seconds are missing."""
    target = output or log.with_name(log.stem + SUFFIX)
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
        say(f"damaged: {missing} missing")
    if not done.missing:
        say("nothing is damaged" if done.closed else "it was cut off; what was written is whole")
    say(f"{done.path}: {done.records} records of {done.duration_s:.1f} s")


def register(app: typer.Typer) -> None:
    """Adds the commands to the `goshawk` command."""
    app.command(
        epilog="Examples: goshawk report flight.mcap | goshawk report flight.mcap -o flight.html --figures figures"
    )(report)
    app.command(
        epilog="Examples: goshawk logs | goshawk logs logs/field --sort clearance | "
        "goshawk logs --where \"policy = '79a16de8' AND clearance_m < 0.5\" --report season.html | "
        "goshawk logs --parquet flights.parquet | goshawk logs --json | jq '.flights[].outcome'"
    )(logs)
    app.command(
        epilog="Examples: goshawk export flight.mcap --format foxglove | goshawk export flight.mcap --format csv -o out"
    )(export)
    app.command(epilog="Examples: goshawk recover flight.mcap | goshawk recover flight.mcap -o clean.mcap")(recover)
