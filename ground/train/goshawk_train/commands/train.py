"""`goshawk train`: a run, and what is made of it. What needs torch is imported where it is used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from goshawk_train.commands.options import SIMULATOR, HeldOut, JsonFile, Run, Simulator
from goshawk_train.commands.process import INTERRUPTED, end, ends_in_one_line, start_for_training
from goshawk_train.config import Config, ConfigError, load_config, replace_training

if TYPE_CHECKING:
    from goshawk_train.model.checkpoint import Checkpoint
    from goshawk_train.model.network import Policy

app = typer.Typer(rich_markup_mode="rich")


@app.command(
    epilog="Examples: "
    "goshawk train run --config ground/train/configs/track.toml --data data/train --validation data/val --out runs/a | "
    "the same with --resume | "
    "goshawk train run --config ground/train/configs/track.toml --data data/b --out runs/b "
    "--from air/models/track-32bit.onnx | torchrun --nproc-per-node 8 --no-python goshawk train run "
    "--config ground/train/configs/track.toml --data data/train --out runs/a"
)
def run(
    context: typer.Context,
    config: Annotated[Path, typer.Option(help="TOML file; see ground/train/configs.")],
    data: Annotated[
        list[Path], typer.Option(metavar="DIR", help="Data set to train on; give it again to mix several.")
    ],
    out: Annotated[Path, typer.Option(help="Folder of the run: checkpoint and TensorBoard events.")],
    validation: Annotated[Path | None, typer.Option(help="Data set of other scenes.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on from the checkpoint in --out, if there is one.")
    ] = False,
    begin: Annotated[
        Path | None,
        typer.Option("--from", metavar="RUN|ONNX", help="Begin with another run's or a policy's weights."),
    ] = None,
    stream: Annotated[
        bool, typer.Option("--stream", help="Read images from disk as steps need them, not into memory first.")
    ] = False,
    samples: Annotated[int | None, typer.Option(help="Length of the run, instead of the configuration's.")] = None,
    threads: Annotated[int | None, typer.Option(help="CPU threads, instead of the configuration's.")] = None,
    simulator: Annotated[
        Path | None, typer.Option(help="A goshawk-sim: score the run by small campaigns as well; needs --validation.")
    ] = None,
    score_minutes: Annotated[float, typer.Option(min=0, help="Time between two scores.")] = 30.0,
) -> None:
    """Train; Ctrl-C saves, --resume goes on exactly there. Several processes share a run under torchrun."""
    start_for_training(context)
    with ends_in_one_line(context):
        from goshawk_train.run import train

        changes = {name: value for name, value in (("samples", samples), ("threads", threads)) if value is not None}
        wanted = replace_training(load_config(config), **changes)
        wanted.validate()
        options = train.RunOptions(
            also=tuple(data[1:]),
            validation=validation,
            stream=stream,
            resume=resume,
            begin=begin,
            simulator=simulator,
            score_minutes=score_minutes,
        )
        end(0 if train.run(wanted, data[0], out, options) else INTERRUPTED)


def _load(folder: Path) -> tuple[Checkpoint, Policy]:
    from goshawk_train.model import checkpoint
    from goshawk_train.model.network import Policy

    saved = checkpoint.load(folder / checkpoint.FILE)
    network = Policy(saved.config)
    checkpoint.load_weights(network, saved)
    return saved, network


def _configuration(config: Config) -> str:
    """The name of the shipped configuration that a run was made with, whatever its length and threads."""
    for path in sorted(Path("ground/train/configs").glob("*.toml")):
        try:
            shipped = load_config(path)
        except ConfigError:  # a table of campaigns
            continue
        training = config.training
        if replace_training(shipped, samples=training.samples, threads=training.threads) == config:
            return f"`{path}`"
    return "of its own"


@app.command(epilog="Example: goshawk train validate --run runs/a --data data/val --json metrics.json")
def validate(
    context: typer.Context,
    run: Run,
    data: HeldOut,
    frames: Annotated[int | None, typer.Option(min=1, help="Number of frames, instead of the configuration's.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Measure a run's averaged weights on held-out scenes."""
    with ends_in_one_line(context):
        from goshawk_train.run.validate import Validator, table

        saved, network = _load(run)
        config = saved.config if frames is None else replace_training(saved.config, validate_frames=frames)
        metrics = Validator(config, data).evaluate(network)
        print(f"step {saved.step}, {saved.step * config.training.batch} samples")
        print(table(metrics))
        if json_file:
            json_file.write_text(json.dumps(metrics, indent=1) + "\n")


@app.command(epilog="Example: goshawk train score --run runs/a --data data/val")
def score(
    context: typer.Context,
    run: Run,
    data: HeldOut,
    simulator: Simulator = SIMULATOR,
    trials: Annotated[int, typer.Option(min=1, help="Flights in each cell.")] = 20,
    json_file: JsonFile = None,
) -> None:
    """Fly small campaigns with a run's averaged weights."""
    with ends_in_one_line(context):
        from goshawk_train.model import checkpoint
        from goshawk_train.run.score import score as fly
        from goshawk_train.run.validate import Validator, table

        saved = checkpoint.load(run / checkpoint.FILE)
        flown = fly(saved, simulator, Validator(saved.config, data), trials=trials)
        print(table(flown))
        if json_file:
            json_file.write_text(json.dumps(flown, indent=1) + "\n")


@app.command(epilog="Example: goshawk train preview --run runs/a --data data/val --out preview.png")
def preview(
    context: typer.Context,
    run: Run,
    data: HeldOut,
    out: Annotated[Path, typer.Option(help="PNG file.")],
    count: Annotated[int, typer.Option(min=1, help="Frames to draw.")] = 4,
    seed: Annotated[int, typer.Option(min=0, help="Which frames.")] = 0,
) -> None:
    """Draw candidates of some frames on the true map."""
    with ends_in_one_line(context):
        from goshawk_train.run.preview import draw

        saved, network = _load(run)
        draw(network, saved.config, data, out, count=count, seed=seed)
        print(out)


@app.command(
    epilog="Examples: goshawk train export --run runs/track --data data/val --out air/models/track-32bit.onnx | "
    "goshawk train export --run runs/track --data data/val --task navigate --out navigate.onnx"
)
def export(
    context: typer.Context,
    run: Run,
    data: HeldOut,
    out: Annotated[Path, typer.Option(help="ONNX file; the card lies beside it as .md.")],
    half: Annotated[
        bool, typer.Option("--half", help="Keep the weights in half precision: half the file, nearly the same answers.")
    ] = False,
    task: Annotated[
        Literal["navigate"] | None, typer.Option(help="Export a tracking run's trajectories for navigation.")
    ] = None,
) -> None:
    """Write the ONNX policy with its contract and its model card, whose figures are of held-out scenes."""
    with ends_in_one_line(context):
        from goshawk_train.model import checkpoint, export
        from goshawk_train.model.card import model_card
        from goshawk_train.model.network import Policy, parameter_count
        from goshawk_train.run.validate import Validator

        saved = checkpoint.load(run / checkpoint.FILE)
        configuration = _configuration(saved.config)
        if task == "navigate":
            saved = export.for_navigation(saved)
        network = Policy(saved.config)
        checkpoint.load_weights(network, saved)
        validator = Validator(saved.config, data)
        scale = validator.cost_scale(saved)
        agreed = export.export(saved, out, commit=export.current_commit(), cost_scale=scale, half=half)
        allowed = export.AGREEMENT_HALF if half else export.AGREEMENT
        worst = export.verify(network.eval(), out, saved.config, agreement=allowed)
        card = model_card(
            saved.config,
            agreed["training"],
            validator.evaluate(network),
            configuration=configuration,
            frames=len(validator.index_F),
            parameters=parameter_count(network),
            file=out,
        )
        out.with_suffix(".md").write_text(card)
        samples = agreed["training"]["samples"]
        print(f"{out}: {out.stat().st_size / 1e6:.1f} MB, {samples} samples, largest difference {worst:.1e}")


@app.command(
    epilog="Example: goshawk train quantise air/models/track-32bit.onnx --data data/val --out air/models/track.onnx"
)
def quantise(
    context: typer.Context,
    policy: Annotated[Path, typer.Argument(metavar="ONNX", help="A policy that `goshawk train export` wrote.")],
    data: Annotated[Path, typer.Option(help="Data set of images as the policy will see them.")],
    out: Annotated[Path, typer.Option(help="ONNX file; the card lies beside it as .md.")],
    frames: Annotated[int, typer.Option(min=16, help="Images that show how large the numbers become.")] = 256,
) -> None:
    """Let a policy's backbone calculate in 8 bits: a third of the file, and faster on processors made for it."""
    with ends_in_one_line(context):
        from goshawk_train.model.card import quantised_card
        from goshawk_train.run.quantise import quantise as in_8_bits

        found = in_8_bits(policy, data, out, frames=frames)
        apart = ", ".join(f"{name} {share:.3f}" for name, share in found.differences.items())
        how = (
            f"The backbone calculates in 8 bits, by {found.calibrated} images of `{data.name}`; the head in 32.\n"
            f"On {found.images} others {found.same_choice:.0%} have the same cheapest candidate. Differences, as\n"
            f"shares of each channel's standard deviation: {apart}."
        )
        card = policy.with_suffix(".md")
        if card.exists():
            out.with_suffix(".md").write_text(quantised_card(card.read_text(), policy, out, how))
        print(f"{out}: {out.stat().st_size / 1e6:.1f} MB, before {policy.stat().st_size / 1e6:.1f}")
        print(
            f"{found.same_choice:.0%} of {found.images} images have the same cheapest candidate; differences: {apart}"
        )


@app.command(epilog="Example: goshawk train bench")
def bench(
    context: typer.Context,
    simulator: Annotated[Path, typer.Option(help="The goshawk-sim that makes the images.")] = SIMULATOR,
    config: Annotated[Path, typer.Option(help="TOML file of a run.")] = Path("ground/train/configs/track.toml"),
    report: Annotated[Path, typer.Option(help="JSON file that the figures are added to.")] = Path("target/bench.json"),
) -> None:
    """Measure how fast training is, against the same network trained plainly, on one thread."""
    with ends_in_one_line(context):
        from goshawk_train.run.bench import KEY, TARGET, measure

        found = measure(simulator, config)
        print(
            f"{KEY}: {found['ratio']:.2f} x plain training (target {TARGET:g}); "
            f"{found['samples_per_s']:.0f} samples/s, plainly {found['plain_samples_per_s']:.0f}, one thread"
        )
        known: dict[str, Any] = json.loads(report.read_text()) if report.exists() else {}
        report.write_text(json.dumps({**known, KEY: {**found, "target": TARGET}}, indent=1) + "\n")
