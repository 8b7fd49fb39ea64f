"""`goshawk dataset`: make, check, import and from-log. Needs no torch."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import typer
from goshawk_dashboards.log.progress import progress_bar

from goshawk_train.commands.options import SIMULATOR
from goshawk_train.commands.process import end, ends_in_one_line
from goshawk_train.data.check import findings
from goshawk_train.data.check.report import FRAMES
from goshawk_train.data.check.report import check as check_data
from goshawk_train.data.flown.mine import REASONS, Reason
from goshawk_train.data.foreign import importer
from goshawk_train.data.foreign.resample import Intrinsics
from goshawk_train.data.foreign.yopo import COLUMNS, VISIBLE, Camera, Format, World

UNFIT = 1
PUBLIC = Format()

app = typer.Typer(rich_markup_mode="rich")


def table(figures: Mapping[str, float]) -> str:
    """Figures as text, a name and a figure a row; counts in full."""
    width = max(len(name) for name in figures)
    shown = {name: f"{value:d}" if isinstance(value, int) else f"{value:.3f}" for name, value in figures.items()}
    return "\n".join(f"  {name:<{width}}  {text:>10}" for name, text in shown.items())


def _above_0(value: float | None) -> float | None:
    if value is not None and not (math.isfinite(value) and value > 0):
        raise typer.BadParameter(f"{value:g} is not above 0")
    return value


def _field_of_view(value: float) -> float:
    if not 5 < value < 170:
        raise typer.BadParameter(f"{value:g} is not between 5 and 170 degrees")
    return value


def _columns(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    if set(names) - {VISIBLE, "-"} != set(COLUMNS) or len(names) - names.count("-") != len(set(names) - {"-"}):
        wanted = f"must name each of {','.join(COLUMNS)} once; - skips a column"
        raise typer.BadParameter(wanted, param_hint="--columns")
    return names


@app.command(
    epilog="Examples: goshawk dataset make --out data/train --scenes 480 | "
    "goshawk dataset make --out data/train --scenes 480 --engine ray --address auto"
)
def make(
    context: typer.Context,
    out: Annotated[Path, typer.Option(metavar="DIR", help="The data set, new or to go on with.")],
    scenes: Annotated[int, typer.Option(min=1, metavar="N", help="Number of scenes.")],
    frames: Annotated[int, typer.Option(min=1, metavar="M", help="Frames in each scene.")] = 128,
    seed: Annotated[
        int, typer.Option(min=0, help="Of everything, of the training range (goshawk-sim seeds).")
    ] = 900_000,
    engine: Annotated[Literal["local", "ray"], typer.Option(help="The cores of this machine, or Ray.")] = "local",
    workers: Annotated[int | None, typer.Option(min=1, metavar="N", help="Cores; default: all.")] = None,
    address: Annotated[str | None, typer.Option(help="A Ray cluster that runs, such as auto.")] = None,
    simulator: Annotated[Path, typer.Option(help="The goshawk-sim that makes the scenes.")] = SIMULATOR,
) -> None:
    """Make a data set, scene by scene, by many workers: the files are those of goshawk-sim dataset. Ctrl-C keeps what
    is finished; the same command goes on."""
    if address and (engine == "local" or workers):
        raise typer.BadParameter("is a cluster's: give --engine ray, without --workers", param_hint="--address")
    with ends_in_one_line(context):
        from goshawk_train.data.made import engines
        from goshawk_train.data.made.make import make as make_data
        from goshawk_train.data.made.make import recipe_of

        program = simulator.absolute()
        recipe = recipe_of(program, scenes=scenes, frames=frames, seed=seed)

        def begin() -> engines.Engine:
            if engine == "local":
                return engines.Local(program, recipe, workers)
            return engines.OnRay(program, recipe, workers, address)

        begun = time.monotonic()
        with progress_bar() as progress:
            new = make_data(program, recipe, out, begin, progress)
        print(f"{out}: {scenes} scenes of {frames} frames ({new} new) in {time.monotonic() - begun:.1f} s")
        print(f"next: goshawk dataset check {out}")


@app.command(
    epilog="Examples: goshawk dataset check data/train --against data/val | "
    "goshawk dataset check data/train --json report.json --sheet sheet.png"
)
def check(
    context: typer.Context,
    data: Annotated[Path, typer.Argument(metavar="DIR", help="The data set.")],
    against: Annotated[
        Path | None, typer.Option(metavar="OTHER", help="Another data set: no scene may be in both.")
    ] = None,
    task: Annotated[Literal["track", "navigate"], typer.Option(help="What it is for.")] = "track",
    frames: Annotated[
        int,
        typer.Option(
            min=1, metavar="N", help="Frames of each scene compared with its map; the rest is checked on all frames."
        ),
    ] = FRAMES,
    json_file: Annotated[
        Path | None, typer.Option("--json", metavar="F", help="Write findings, figures and histograms there.")
    ] = None,
    sheet: Annotated[
        Path | None, typer.Option(metavar="PNG", help="The contact sheet; default: DIR/contact-sheet.png.")
    ] = None,
) -> None:
    """Find what ruins training before it starts. Exit status 0: fit, 1: errors, 2: no data set."""
    with ends_in_one_line(context):
        from goshawk_train.data.check.sheet import draw  # matplotlib takes a second

        with progress_bar() as progress:
            report = check_data(data, against=against, frames=frames, task=task, progress=progress)
        for line in findings.lines(report.findings):
            print(line)
        picture = sheet or data / "contact-sheet.png"
        draw(report, picture)
        if json_file:
            json_file.write_text(json.dumps(report.json(), indent=1) + "\n")
        print(f"contact sheet: {picture}")
        print(table(report.figures()))
        end(UNFIT if report.errors else 0)


@app.command(
    "import",
    epilog="Examples: goshawk dataset import ~/YOPO-Tracker/dataset --out data/yopo | "
    "goshawk dataset import recordings --out data/field --tilt-deg 20 --fx 320 --cx 322 --cy 182",
)
def import_scenes(
    context: typer.Context,
    source: Annotated[
        Path, typer.Argument(metavar="SRC", help="A scene, or the folder of scenes (scene-0, scene-1, …).")
    ],
    out: Annotated[Path, typer.Option(metavar="DIR", help="The data set, new or to go on with.")],
    columns: Annotated[
        str,
        typer.Option(
            show_default=False,
            help="Order in labels.csv; a `visible` 0..1 may follow, - skips a column. "
            f"Default: {', '.join(PUBLIC.columns)}.",
        ),
    ] = ",".join(PUBLIC.columns),
    world: Annotated[World, typer.Option(help="Axes of positions and map: nwu, any with z up, or ned.")] = PUBLIC.world,
    camera: Annotated[
        Camera,
        typer.Option(
            help="Axes that the attitudes speak of: forward left up, forward right down, or right down forward."
        ),
    ] = PUBLIC.camera,
    tilt_deg: Annotated[
        float, typer.Option(metavar="A", help="The camera's pitch up against those axes, where they are the vehicle's.")
    ] = PUBLIC.tilt_deg,
    depth_unit_mm: Annotated[
        float, typer.Option(metavar="U", callback=_above_0, help="Millimetres for one unit of depth.")
    ] = PUBLIC.depth_unit_mm,
    hfov_deg: Annotated[
        float,
        typer.Option(
            metavar="A", callback=_field_of_view, help="Horizontal field of view of the source, square pixels."
        ),
    ] = PUBLIC.hfov_deg,
    fx: Annotated[
        float | None,
        typer.Option(
            metavar="PX", callback=_above_0, help="Instead of --hfov-deg: focal length across, source pixels."
        ),
    ] = None,
    fy: Annotated[
        float | None,
        typer.Option(metavar="PX", callback=_above_0, help="Focal length down, source pixels; default: --fx."),
    ] = None,
    cx: Annotated[float | None, typer.Option(metavar="PX", help="With --fx: the optical axis from the left.")] = None,
    cy: Annotated[float | None, typer.Option(metavar="PX", help="With --fx: the optical axis from the top.")] = None,
) -> None:
    """Convert scenes of the public YOPO-Tracker's layout. Goes on where it stopped."""
    form = Format(
        columns=_columns(columns),
        world=world,
        camera=camera,
        tilt_deg=tilt_deg,
        depth_unit_mm=depth_unit_mm,
        hfov_deg=hfov_deg,
        focal=_focal(fx, fy, cx, cy),
    )
    with ends_in_one_line(context):
        with progress_bar() as progress:
            outcome = importer.import_scenes(source, out, form, progress)
        for note in outcome.notes:
            print(f"note: {note}")
        print(table({"imported": outcome.imported, "kept": outcome.kept, "frames": outcome.frames}))
        print(f"next: goshawk dataset check {out}")


def _reasons(text: str) -> tuple[Reason, ...]:
    asked = [name.strip() for name in text.split(",") if name.strip()]
    unknown = [name for name in asked if name not in REASONS]
    if unknown:
        raise typer.BadParameter(f"{unknown[0]} is none of {', '.join(REASONS)}", param_hint="--mine")
    return tuple(name for name in REASONS if name in asked)


@app.command(
    epilog="Examples: goshawk dataset from-log logs --out data/flown | "
    "goshawk dataset from-log logs/a.mcap logs/b.mcap --out data/hard --rate-hz 2 --mine near-miss,lost,doubt | "
    "goshawk dataset from-log logs --out data/differ --rate-hz 0 --mine disagree --other runs/new.onnx"
)
def from_log(
    context: typer.Context,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG…", help="Flight logs, or folders of them.")],
    out: Annotated[Path, typer.Option(metavar="DIR", help="The data set, a new folder.")],
    rate_hz: Annotated[
        float, typer.Option(min=0, metavar="HZ", help="Images that are kept of each second; 0: the mined alone.")
    ] = 5.0,
    mine: Annotated[
        str,
        typer.Option(
            metavar="R[,R…]",
            show_default=False,
            help="Keep all images of these reasons. " + " ".join(f"{name}: {what}." for name, what in REASONS.items()),
        ),
    ] = "",
    other: Annotated[
        Path | None, typer.Option(metavar="ONNX", help="The policy that may disagree; needs --mine disagree.")
    ] = None,
) -> None:
    """Make a data set of flights: the map fused from their depth, labels from their smoothed target."""
    reasons = _reasons(mine)
    if ("disagree" in reasons) != (other is not None):
        raise typer.BadParameter("--mine disagree and --other belong together", param_hint="--mine")
    with ends_in_one_line(context, "nothing was written: it begins anew"):
        from goshawk_train.data.flown import convert

        choice = convert.Choice(rate_hz=rate_hz, mine=reasons, other=other)
        with progress_bar() as progress:
            outcome = convert.from_logs(logs, out, choice, progress)
        for note in outcome.notes:
            print(f"note: {note}")
        print(outcome.table())
        print(f"next: goshawk dataset check {out}")


def _focal(fx: float | None, fy: float | None, cx: float | None, cy: float | None) -> Intrinsics | None:
    if fx is not None and cx is not None and cy is not None:
        return Intrinsics(fx=fx, fy=fy or fx, cx=cx, cy=cy)
    if any(value is not None for value in (fx, fy, cx, cy)):
        raise typer.BadParameter("--fx, --cx and --cy belong together")
    return None
