"""The commands about flight logs: `export`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer
from goshawk_dashboards.exports import ExportError, Format, export_log

from goshawk_ground.options import NO_REPLY, Json, LogFile, fail, open_flight, print_json

LAYOUT = Path("dashboards/foxglove/goshawk.json")

_HINTS = {
    Format.FOXGLOVE: f"open it in Foxglove or Lichtblick, with the layout {LAYOUT}",
    Format.RERUN: "open it with: rerun {path}",
    Format.ROS2: "play it with: ros2 bag play -s mcap {path}",
    Format.CSV: "one file a channel, images beside them",
}


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


def register(app: typer.Typer) -> None:
    """Adds the commands to the `goshawk` command."""
    app.command(
        epilog="Examples: goshawk export flight.mcap --format foxglove | goshawk export flight.mcap --format csv -o out"
    )(export)
