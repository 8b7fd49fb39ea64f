"""`goshawk campaign`, the trainer's part: flights for tables and figures, and trainings that are flown."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from goshawk_train.commands import cluster
from goshawk_train.commands.options import MODELS, RESULTS, SIMULATOR, Markdown, Models, Simulator, Trials
from goshawk_train.commands.process import INTERRUPTED, end, ends_in_one_line, start_for_training

app = typer.Typer(rich_markup_mode="rich")
cluster.register(app)


@app.command(
    epilog="Examples: goshawk campaign flights | goshawk campaign flights --trials 10 --out out --markdown out/table.md"
)
def flights(
    context: typer.Context,
    table: Annotated[Path, typer.Option(help="Its rows.")] = Path("ground/train/configs/flights.toml"),
    models: Models = MODELS,
    simulator: Simulator = SIMULATOR,
    trials: Trials = None,
    out: Annotated[Path, typer.Option(help="Folder of the rows' JSON.")] = Path("ground/train/results"),
    markdown: Markdown = RESULTS,
    write_only: Annotated[
        bool, typer.Option("--write-only", help="Write the table from what was flown before; fly nothing.")
    ] = False,
) -> None:
    """Fly the flight table of RESULTS.md: what was not flown yet, and what is stale; goes on where it stopped."""
    with ends_in_one_line(context):
        from goshawk_train.campaigns import flights

        each, rows = flights.load(table)
        out.mkdir(parents=True, exist_ok=True)
        flown = [flights.kept(row, out, simulator, models, trials=trials or each) for row in rows]
        flights.put(markdown, flights.markdown(flown))
        for place, row in enumerate(rows):
            if not (flown[place].fresh or write_only):
                flown[place] = flights.fly_row(row, out, simulator, models, trials=trials or each)
                flights.put(markdown, flights.markdown(flown))
            if markdown.resolve() == RESULTS.resolve():  # the cards say what the results do
                flights.put_on_card(models, row.task, flown)
        print(markdown)


@app.command(
    epilog="Examples: goshawk campaign robustness | goshawk campaign robustness --trials 5 --out out --figure out.png"
)
def robustness(
    context: typer.Context,
    sweeps: Annotated[Path, typer.Option(help="What is varied.")] = Path("ground/train/configs/robustness.toml"),
    models: Models = MODELS,
    simulator: Simulator = SIMULATOR,
    trials: Trials = None,
    out: Annotated[Path, typer.Option(help="Folder of the JSON.")] = Path("ground/train/results/robustness"),
    figure: Annotated[Path, typer.Option(help="PNG file.")] = Path("docs/robustness.png"),
) -> None:
    """Fly with more and more wind, delay, noise and spread, and draw the successes; goes on where it stopped."""
    with ends_in_one_line(context):
        from goshawk_train.campaigns import flights, robustness

        each, seed, speeds_mps, troubles = robustness.load(sweeps)
        out.mkdir(parents=True, exist_ok=True)
        points: list[tuple[Any, str, float, dict[str, Any]]] = []
        for sweep in troubles:
            for task, speed_mps in speeds_mps.items():
                for value in sweep.values:
                    row = sweep.row(task, speed_mps, value)
                    report = flights.fly(row, out, simulator, models, trials=trials or each, seed=seed)
                    points.append((sweep, task, value, report["cells"][0]))
            robustness.draw(points, figure)
        print(figure)


@app.command(
    epilog="Examples: goshawk campaign extensions | goshawk campaign extensions --only the-paper-s-method --trials 20 "
    "--out out --markdown out/table.md"
)
def extensions(
    context: typer.Context,
    plan: Annotated[Path, typer.Option(help="The parts and the campaigns.")] = Path(
        "ground/train/configs/extensions.toml"
    ),
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="This line, named as its folder in --out; give it again for several."),
    ] = None,
    models: Models = MODELS,
    simulator: Simulator = SIMULATOR,
    trials: Trials = None,
    runs: Annotated[
        Path | None,
        typer.Option(help="Folder of vehicle files and reports.", show_default="runs/, and the plan's name"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder of the JSON.", show_default="ground/train/results/, and the plan's name"),
    ] = None,
    markdown: Markdown = RESULTS,
) -> None:
    """Fly the paper's method, with each part beyond it alone, all, and all but each; goes on where it stopped."""
    with ends_in_one_line(context):
        from dataclasses import replace

        from goshawk_train.campaigns import extensions, flights

        listed = extensions.load(plan)
        listed = replace(listed, trials=trials or listed.trials)
        runs, out = runs or Path("runs") / listed.table, out or Path("ground/train/results") / listed.table
        for variant in listed.only(only or []).variants:
            print(f"{variant.name}:", flush=True)
            extensions.carry_out(listed, variant, out, runs, simulator, models)
            found = {one.slug: extensions.kept(listed, one, out, simulator, models) for one in listed.variants}
            known = {slug: line for slug, line in found.items() if line is not None}
            flights.put(markdown, extensions.markdown(listed, known), listed.marks)
        print(markdown)


@app.command(
    epilog="Examples: goshawk campaign ablations | goshawk campaign ablations --only none --only no-image-augmentation"
)
def ablations(
    context: typer.Context,
    plan: Annotated[Path, typer.Option(help="The trainings.")] = Path("ground/train/configs/ablations.toml"),
    only: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="This one, named as its file in --out; give it again for several."),
    ] = None,
    runs: Annotated[Path, typer.Option(help="Folder of data sets and runs.")] = Path("runs/ablations"),
    simulator: Simulator = SIMULATOR,
    out: Annotated[Path, typer.Option(help="Folder of the JSON.")] = Path("ground/train/results/ablations"),
    markdown: Markdown = RESULTS,
) -> None:
    """Train and fly what differs in one thing, for RESULTS.md; goes on where it stopped."""
    start_for_training(context)
    with ends_in_one_line(context):
        from goshawk_train.campaigns import ablations, flights

        listed = ablations.load(plan)
        for change in listed.only(only or []).changes:
            if ablations.carry_out(listed, change, out, runs, simulator) is None:
                end(INTERRUPTED)
            known = [(other, ablations.kept(listed, other, out)) for other in listed.changes]
            table = ablations.markdown(listed, [(other, result) for other, result in known if result])
            flights.put(markdown, table, ablations.MARKS)
        print(markdown)
