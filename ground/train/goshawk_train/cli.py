"""The command line: dataset, train, score, validate, preview, export. What needs torch imports it where it runs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from goshawk_train.config import ConfigError, load_config, replace_training
from goshawk_train.dataset import DataError

if TYPE_CHECKING:
    from goshawk_train.checkpoint import Checkpoint
    from goshawk_train.network import Policy

EXAMPLES = """examples:
  python -m goshawk_train dataset  check data/train --against data/val
  python -m goshawk_train train    --config configs/track.toml --data data/train --validation data/val --out runs/a
  python -m goshawk_train train    --config configs/track.toml --data data/train --out runs/a --resume
  python -m goshawk_train train    --config configs/track.toml --data data/b --out runs/b --from air/models/track.onnx
  torchrun --nproc-per-node 8 -m goshawk_train train --config configs/track.toml --data data/train --out runs/a
  python -m goshawk_train score    --run runs/a
  python -m goshawk_train flights  --trials 100
  python -m goshawk_train robustness
  python -m goshawk_train ablations
  python -m goshawk_train validate --run runs/a --data data/val --json metrics.json
  python -m goshawk_train preview  --run runs/a --data data/val --out preview.png
  python -m goshawk_train export   --run runs/a --data data/val --out air/models/track.onnx
  python -m goshawk_train train    --config configs/navigate.toml --data data/train --out runs/n --from runs/a
  python -m goshawk_train export   --run runs/n --data data/val --out air/models/navigate.onnx
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="goshawk_train",
        description="Train Goshawk's policies on a data set of `goshawk-sim dataset` or `dataset import`.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)

    def add(name: str, text: str) -> argparse.ArgumentParser:
        return commands.add_parser(
            name, help=text, description=text, epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter
        )

    commands.add_parser("dataset", add_help=False, help="Check a data set, or import one of another layout.")
    run = add("train", "Train; Ctrl-C saves, --resume goes on exactly there.")
    run.add_argument("--config", type=Path, required=True, help="TOML file, see configs/")
    run.add_argument("--data", type=Path, required=True, help="data set to train on")
    run.add_argument("--validation", type=Path, help="data set of other scenes")
    run.add_argument("--out", type=Path, required=True, help="folder of the run: checkpoint and TensorBoard events")
    run.add_argument("--resume", action="store_true", help="go on from the checkpoint in --out, if there is one")
    run.add_argument(
        "--from", dest="begin", type=Path, metavar="RUN|ONNX", help="begin with another run's or a policy's weights"
    )
    run.add_argument("--samples", type=int, help="length of the run, instead of the configuration's")
    run.add_argument("--threads", type=int, help="CPU threads, instead of the configuration's")
    run.add_argument("--simulator", type=Path, help="goshawk-sim: score the run by small campaigns as well")
    run.add_argument("--score-minutes", type=float, default=30.0, help="time between two scores (default 30)")
    fly = add("score", "Fly small campaigns with a run's averaged weights.")
    fly.add_argument("--simulator", type=Path, default=Path("target/release/goshawk-sim"), help="goshawk-sim")
    fly.add_argument("--trials", type=int, default=20, help="flights in each cell (default 20)")
    fly.add_argument("--json", type=Path, help="write the shares there as well")
    table = add("flights", "Fly the flight table of RESULTS.md; goes on where it stopped.")
    table.add_argument("--table", type=Path, default=Path("ground/train/configs/flights.toml"), help="its rows")
    table.add_argument("--models", type=Path, default=Path("air/models"), help="folder of track.onnx and navigate.onnx")
    table.add_argument("--simulator", type=Path, default=Path("target/release/goshawk-sim"), help="goshawk-sim")
    table.add_argument("--trials", type=int, help="flights in each cell, instead of the table's")
    table.add_argument("--out", type=Path, default=Path("ground/train/results"), help="folder of the rows' JSON")
    table.add_argument("--markdown", type=Path, default=Path("ground/train/RESULTS.md"), help="where the table stands")
    bears = add("robustness", "Fly with more and more wind, delay, noise and spread, and draw the successes.")
    bears.add_argument(
        "--sweeps", type=Path, default=Path("ground/train/configs/robustness.toml"), help="what is varied"
    )
    bears.add_argument("--models", type=Path, default=Path("air/models"), help="folder of track.onnx and navigate.onnx")
    bears.add_argument("--simulator", type=Path, default=Path("target/release/goshawk-sim"), help="goshawk-sim")
    bears.add_argument("--trials", type=int, help="flights in each campaign, instead of the file's")
    bears.add_argument("--out", type=Path, default=Path("ground/train/results/robustness"), help="folder of the JSON")
    bears.add_argument("--figure", type=Path, default=Path("docs/robustness.png"), help="PNG file")
    matters = add("ablations", "Train and fly what differs in one thing, for RESULTS.md; goes on where it stopped.")
    matters.add_argument("--plan", type=Path, default=Path("ground/train/configs/ablations.toml"), help="the trainings")
    matters.add_argument("--only", nargs="+", default=[], metavar="NAME", help="these, named as their files in --out")
    matters.add_argument("--runs", type=Path, default=Path("runs/ablations"), help="folder of data sets and runs")
    matters.add_argument("--simulator", type=Path, default=Path("target/release/goshawk-sim"), help="goshawk-sim")
    matters.add_argument("--out", type=Path, default=Path("ground/train/results/ablations"), help="folder of the JSON")
    matters.add_argument(
        "--markdown", type=Path, default=Path("ground/train/RESULTS.md"), help="where the table stands"
    )
    measure = add("validate", "Measure a run's averaged weights on held-out scenes.")
    picture = add("preview", "Draw candidates of some frames on the true map.")
    ship = add("export", "Write the ONNX policy with its contract, and its model card if --data is given.")
    for command in (fly, measure, picture, ship):
        command.add_argument("--run", type=Path, required=True, help="folder of the run")
    for command in (measure, picture):
        command.add_argument("--data", type=Path, required=True, help="data set of held-out scenes")
    measure.add_argument("--json", type=Path, help="write the figures there as well")
    measure.add_argument("--frames", type=int, help="number of frames, instead of the configuration's")
    picture.add_argument("--out", type=Path, required=True, help="PNG file")
    picture.add_argument("--count", type=int, default=4, help="frames to draw (default 4)")
    picture.add_argument("--seed", type=int, default=0, help="which frames (default 0)")
    ship.add_argument("--task", choices=["navigate"], help="export a tracking run's trajectories for navigation")
    ship.add_argument("--data", type=Path, help="held-out scenes for the model card's figures")
    ship.add_argument("--out", type=Path, required=True, help="ONNX file; the card lies beside it as .md")
    return parser


def _train(args: argparse.Namespace) -> int:
    from goshawk_train import train

    changes = {k: v for k, v in (("samples", args.samples), ("threads", args.threads)) if v is not None}
    config = replace_training(load_config(args.config), **changes)
    config.validate()
    options = train.RunOptions(
        validation=args.validation,
        resume=args.resume,
        begin=args.begin,
        simulator=args.simulator,
        score_minutes=args.score_minutes,
    )
    return 0 if train.run(config, args.data, args.out, options) else 130


def _load(folder: Path) -> tuple[Checkpoint, Policy]:
    from goshawk_train import checkpoint, train

    saved = checkpoint.load(folder / train.CHECKPOINT)
    network = train.Policy(saved.config)
    checkpoint.load_weights(network, saved)
    return saved, network


def _validate(args: argparse.Namespace) -> int:
    from goshawk_train import validate

    saved, network = _load(args.run)
    config = saved.config
    if args.frames is not None:
        config = replace_training(config, validate_frames=args.frames)
    metrics = validate.Validator(config, args.data).evaluate(network)
    print(f"step {saved.step}, {saved.step * config.training.batch} samples")
    print(validate.table(metrics))
    if args.json:
        args.json.write_text(json.dumps(metrics, indent=1) + "\n")
    return 0


def _score(args: argparse.Namespace) -> int:
    from goshawk_train import checkpoint, train, validate
    from goshawk_train.score import score

    flown = score(checkpoint.load(args.run / train.CHECKPOINT), args.simulator, trials=args.trials)
    print(validate.table(flown))
    if args.json:
        args.json.write_text(json.dumps(flown, indent=1) + "\n")
    return 0


def _flights(args: argparse.Namespace) -> int:
    from goshawk_train import flights

    trials, seed, rows = flights.load(args.table)
    args.out.mkdir(parents=True, exist_ok=True)
    flown = []
    for row in rows:
        count = args.trials or trials
        report = flights.fly(row, args.out, args.simulator, args.models, trials=count, seed=seed)
        flown.append((row, report))
        flights.put(args.markdown, flights.markdown(flown))
        flights.put_on_card(args.models, row.task, flown)
    print(args.markdown)
    return 0


def _robustness(args: argparse.Namespace) -> int:
    from goshawk_train import flights, robustness

    trials, seed, speeds_mps, sweeps = robustness.load(args.sweeps)
    args.out.mkdir(parents=True, exist_ok=True)
    points = []
    for sweep in sweeps:
        for task, speed_mps in speeds_mps.items():
            for value in sweep.values:
                row, count = sweep.row(task, speed_mps, value), args.trials or trials
                report = flights.fly(row, args.out, args.simulator, args.models, trials=count, seed=seed)
                points.append((sweep, task, value, report["cells"][0]))
        robustness.draw(points, args.figure)
    print(args.figure)
    return 0


def _ablations(args: argparse.Namespace) -> int:
    from goshawk_train import ablations, flights

    plan = ablations.load(args.plan)
    for change in plan.only(args.only).changes:
        if ablations.carry_out(plan, change, args.out, args.runs, args.simulator) is None:
            return 130
        known = [(other, ablations.kept(plan, other, args.out)) for other in plan.changes]
        table = ablations.markdown(plan, [(other, result) for other, result in known if result])
        flights.put(args.markdown, table, ablations.MARKS)
    print(args.markdown)
    return 0


def _preview(args: argparse.Namespace) -> int:
    from goshawk_train.preview import draw

    saved, network = _load(args.run)
    draw(network, saved.config, args.data, args.out, count=args.count, seed=args.seed)
    print(args.out)
    return 0


def _export(args: argparse.Namespace) -> int:
    from goshawk_train import checkpoint, export, train, validate

    saved = checkpoint.load(args.run / train.CHECKPOINT)
    trained_as = saved.config.task
    if args.task == "navigate":
        saved = export.for_navigation(saved)
    network = train.Policy(saved.config)
    checkpoint.load_weights(network, saved)
    agreed = export.export(saved, args.out, commit=export.current_commit())
    worst = export.verify(network.eval(), args.out, saved.config)
    if args.data:
        validator = validate.Validator(saved.config, args.data)
        metrics = validator.evaluate(network)
        frames = len(validator.index_F)
        card = export.model_card(saved, agreed, metrics, trained_as=trained_as, frames=frames, file=args.out)
        args.out.with_suffix(".md").write_text(card)
    samples = agreed["training"]["samples"]
    print(f"{args.out}: {args.out.stat().st_size / 1e6:.1f} MB, {samples} samples, largest difference {worst:.1e}")
    return 0


def _run(args: argparse.Namespace) -> int:
    from goshawk_train.checkpoint import CheckpointError
    from goshawk_train.export import ExportError
    from goshawk_train.flights import FlightsError
    from goshawk_train.score import ScoreError
    from goshawk_train.train import TrainingError

    commands = {
        "train": _train,
        "score": _score,
        "flights": _flights,
        "robustness": _robustness,
        "ablations": _ablations,
        "validate": _validate,
        "preview": _preview,
        "export": _export,
    }
    try:
        return commands[args.command](args)
    except (ConfigError, DataError, ExportError, FlightsError, ScoreError, TrainingError, CheckpointError) as error:
        print(f"goshawk_train {args.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"goshawk_train {args.command}: interrupted; what is finished is kept", file=sys.stderr)
        return 130


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns the exit status."""
    arguments = sys.argv[1:] if argv is None else argv
    if arguments[:1] == ["dataset"]:
        from goshawk_train.dataset import cli as dataset

        return dataset.main(arguments[1:])
    return _run(_parser().parse_args(arguments))
