"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

SIMULATOR, MODELS, RESULTS = Path("target/release/goshawk-sim"), Path("air/models"), Path("ground/train/RESULTS.md")

Run = Annotated[Path, typer.Option(help="Folder of the run.")]
HeldOut = Annotated[Path, typer.Option(help="Data set of held-out scenes.")]
Simulator = Annotated[Path, typer.Option(help="The goshawk-sim that flies.")]
Models = Annotated[Path, typer.Option(help="Folder of track.onnx and navigate.onnx.")]
Markdown = Annotated[Path, typer.Option(help="Where the table stands.")]
Trials = Annotated[int | None, typer.Option(min=1, help="Flights in each campaign's cell, instead of the file's.")]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the figures there as well.")]
