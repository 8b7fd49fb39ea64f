"""`python -m goshawk_train dataset`, which is also `goshawk dataset`: check and import. Needs no torch."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from goshawk_train.dataset import DataError, Progress, check, findings, importer
from goshawk_train.dataset.foreign import CAMERAS, COLUMNS, VISIBLE, WORLDS, Format
from goshawk_train.dataset.resample import Intrinsics

EXAMPLES = """examples:
  goshawk dataset check data/train --against data/val
  goshawk dataset check data/train --json report.json --sheet sheet.png
  goshawk dataset import ~/YOPO-Tracker/dataset --out data/yopo
  goshawk dataset import recordings --out data/field --tilt-deg 20 --fx 320 --cx 322 --cy 182
"""
UNFIT, UNUSABLE = 1, 2


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar on a terminal, nothing elsewhere."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        tasks = {}

        def update(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done, total=total)

        yield update


def table(figures: Mapping[str, float]) -> str:
    """Figures as text, a name and a figure a row; counts in full."""
    width = max(len(name) for name in figures)
    shown = {name: f"{value:d}" if isinstance(value, int) else f"{value:.3f}" for name, value in figures.items()}
    return "\n".join(f"  {name:<{width}}  {text:>10}" for name, text in shown.items())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="goshawk dataset",
        description="Data sets for training: check one, or import recordings of another layout.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)

    def add(name: str, text: str) -> argparse.ArgumentParser:
        return commands.add_parser(
            name, help=text, description=text, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
        )

    look = add("check", "Find what ruins training before it starts. Exit status 0: fit, 1: errors, 2: no data set.")
    look.add_argument("data", type=Path, metavar="DIR", help="the data set")
    look.add_argument("--against", type=Path, metavar="OTHER", help="another data set: no scene may be in both")
    look.add_argument("--task", choices=("track", "navigate"), default="track", help="what it is for (default track)")
    look.add_argument(
        "--frames",
        type=count,
        default=check.FRAMES,
        metavar="N",
        help=f"frames of each scene compared with its map (default {check.FRAMES}); the rest is checked on all frames",
    )
    look.add_argument("--json", type=Path, metavar="F", help="write findings, figures and histograms there")
    look.add_argument("--sheet", type=Path, metavar="PNG", help="the contact sheet (default DIR/contact-sheet.png)")
    bring = add("import", "Convert scenes of the public YOPO-Tracker's layout. Goes on where it stopped.")
    _add_import(bring)
    return parser


def _add_import(bring: argparse.ArgumentParser) -> None:
    default = Format()
    bring.add_argument(
        "source", type=Path, metavar="SRC", help="a scene, or the folder of scenes (scene-0, scene-1, ..)"
    )
    bring.add_argument("--out", type=Path, required=True, metavar="DIR", help="the data set, new or to go on with")
    bring.add_argument(
        "--columns",
        type=_columns,
        default=default.columns,
        help=f"order in labels.csv (default {','.join(default.columns)}; a `visible` 0..1 may follow)",
    )
    world = "axes of positions and map: nwu, any with z up (default), or ned"
    bring.add_argument("--world", choices=sorted(WORLDS), default=default.world, help=world)
    camera = "axes that the attitudes speak of: forward left up (default), forward right down, or right down forward"
    bring.add_argument("--camera", choices=sorted(CAMERAS), default=default.camera, help=camera)
    tilt = "the camera's pitch up against those axes, where they are the vehicle's (default 0)"
    bring.add_argument("--tilt-deg", type=float, default=default.tilt_deg, metavar="A", help=tilt)
    unit = "millimetres for one unit of depth (default 1)"
    bring.add_argument("--depth-unit-mm", type=length, default=default.depth_unit_mm, metavar="U", help=unit)
    field = "horizontal field of view of the source, square pixels (default 90)"
    bring.add_argument("--hfov-deg", type=angle, default=default.hfov_deg, metavar="A", help=field)
    for name, text in (("fx", "focal length across"), ("fy", "focal length down (default --fx)")):
        bring.add_argument(f"--{name}", type=length, metavar="PX", help=f"instead of --hfov-deg: {text}, source pixels")
    for name, text in (("cx", "from the left"), ("cy", "from the top")):
        bring.add_argument(f"--{name}", type=float, metavar="PX", help=f"with --fx: the optical axis {text}")


def _columns(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    if set(names) - {VISIBLE, "-"} != set(COLUMNS) or len(names) - names.count("-") != len(set(names) - {"-"}):
        raise argparse.ArgumentTypeError(f"must name each of {','.join(COLUMNS)} once; - skips a column")
    return names


def length(text: str) -> float:
    """A positive number, for argparse, which names it in its refusals."""
    value = float(text)
    if not (math.isfinite(value) and value > 0):
        raise argparse.ArgumentTypeError(f"{text} is not above 0")
    return value


def angle(text: str) -> float:
    """Degrees of a field of view."""
    value = float(text)
    if not 5 < value < 170:
        raise argparse.ArgumentTypeError(f"{text} is not between 5 and 170 degrees")
    return value


def count(text: str) -> int:
    """A number of things."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is not above 0")
    return value


def _check(args: argparse.Namespace) -> int:
    from goshawk_train.dataset import sheet  # matplotlib takes a second

    with progress_bar() as progress:
        report = check.check(args.data, against=args.against, frames=args.frames, task=args.task, progress=progress)
    for line in findings.lines(report.findings):
        print(line)
    picture = args.sheet or args.data / "contact-sheet.png"
    sheet.draw(report, picture)
    if args.json:
        args.json.write_text(json.dumps(report.json(), indent=1) + "\n")
    print(f"contact sheet: {picture}")
    print(table(report.figures()))
    return UNFIT if report.errors else 0


def _import(args: argparse.Namespace) -> int:
    pixels = (args.fx, args.cx, args.cy)
    if any(value is not None for value in (*pixels, args.fy)) and None in pixels:
        raise DataError("--fx, --cx and --cy belong together")
    focal = None if args.fx is None else Intrinsics(fx=args.fx, fy=args.fy or args.fx, cx=args.cx, cy=args.cy)
    form = Format(
        columns=args.columns,
        world=args.world,
        camera=args.camera,
        tilt_deg=args.tilt_deg,
        depth_unit_mm=args.depth_unit_mm,
        hfov_deg=args.hfov_deg,
        focal=focal,
    )
    with progress_bar() as progress:
        outcome = importer.import_scenes(args.source, args.out, form, progress)
    for note in outcome.notes:
        print(f"note: {note}")
    print(table({"imported": outcome.imported, "kept": outcome.kept, "frames": outcome.frames}))
    print(f"next: goshawk dataset check {args.out}")
    return 0


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    args = _parser().parse_args(argv)
    try:
        return {"check": _check, "import": _import}[args.command](args)
    except (DataError, OSError) as error:
        print(f"goshawk dataset {args.command}: {error}", file=sys.stderr)
        return UNUSABLE
    except KeyboardInterrupt:
        print(f"goshawk dataset {args.command}: interrupted", file=sys.stderr)
        return 130
