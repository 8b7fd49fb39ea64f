"""The training loop (section III-E).

Everything random is a pure function of (seed, step), and the schedule of the step, so a resumed run repeats exactly
what an uninterrupted one would have done.
"""

from __future__ import annotations

import ctypes
import math
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Self, cast

import numpy as np
import torch
from torch.utils.tensorboard import SummaryWriter

from goshawk_train.config import Config, replace_training
from goshawk_train.costs.batch import Batch
from goshawk_train.costs.esdf import SceneMaps
from goshawk_train.costs.losses import LossModel, Outcome
from goshawk_train.costs.trajectory import CostModel
from goshawk_train.data import batches
from goshawk_train.data.layout import describe, scene_folders
from goshawk_train.errors import TrainerError
from goshawk_train.model import checkpoint
from goshawk_train.model.checkpoint import Checkpoint, Ema
from goshawk_train.model.network import Policy, parameter_count
from goshawk_train.run import score, validate
from goshawk_train.run.beginning import Beginning, normalise, of_policy, of_run
from goshawk_train.run.workers import Workers, join, leave

NORMALISING_FRAMES = 512
"""That a policy's file without batch norms gets new ones of."""
BEGUN_FROM = ", begun from "
"""In a data set's name, before what its run began with."""
ALONE = Workers(torch.device("cpu"))


class TrainingError(TrainerError):
    """Training cannot go on; the message says why and what to do."""


def learning_rate(step: int, *, total: int, warm_up: int, peak: float, final_fraction: float) -> float:
    """Linear warm-up over `warm_up` steps, then a cosine down to `final_fraction` of the peak."""
    if step < warm_up:
        return peak * (step + 1) / warm_up
    progress = min(1.0, (step - warm_up) / max(1, total - warm_up))
    return peak * (final_fraction + (1 - final_fraction) * 0.5 * (1 + math.cos(math.pi * progress)))


class Trainer:
    """A run: network, optimiser, average and data, advanced one step at a time."""

    def __init__(
        self, config: Config, frames: batches.Frames, maps: SceneMaps, *, data_name: str, workers: Workers = ALONE
    ) -> None:
        batch = config.training.batch
        if len(frames) < batch:
            raise TrainingError(f"{len(frames)} frames are fewer than one step of {batch}")
        if batch < workers.count:
            raise TrainingError(f"a step of {batch} images is too small for {workers.count} processes; start fewer")
        torch.manual_seed(config.seed)
        self.config, self.frames, self.data_name, self.workers = config, frames, data_name, workers
        network = Policy(config)  # on the CPU, so that a seed means the same everywhere
        workers.join_norms(network)
        to = cast("Callable[..., Policy]", network.to)  # torch's types know no memory format of a module
        self.network = to(device=workers.device, memory_format=torch.channels_last)
        workers.share(self.network)
        with workers.device:
            self.losses = LossModel(config, CostModel(config, maps.to(workers.device)))
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(),
            lr=config.training.learning_rate,
            weight_decay=config.training.weight_decay,
            fused=True,
        )
        self.ema = Ema(self.network, config.training.ema)
        self.steps_per_epoch = len(frames) // batch
        self.total_steps = math.ceil(config.training.samples / batch)
        self.step, self.seconds = 0, 0.0
        self.bf16 = config.training.bf16 and workers.has_bf16
        """The backbone computes with bfloat16."""
        self._order = (-1, np.zeros(0, dtype=np.int64))
        self._ahead: tuple[int, Batch] | None = None

    def snapshot(self) -> Checkpoint:
        """The run as it can be written to disk."""
        return Checkpoint(
            config=self.config,
            step=self.step,
            seconds=self.seconds,
            data=self.data_name,
            network={name: value.cpu() for name, value in self.network.state_dict().items()},
            ema={name: value.cpu() for name, value in self.ema.state_dict().items()},
            optimiser=self.optimiser.state_dict(),
            hardware=self.workers.hardware(),
        )

    def restore(self, saved: Checkpoint) -> None:
        """Go on from a checkpoint; raises `TrainingError` if it belongs to another run.

        The length of the run and the threads may differ: the schedule then continues towards the new end.
        """
        training = self.config.training
        if replace_training(saved.config, samples=training.samples, threads=training.threads) != self.config:
            raise TrainingError("the checkpoint was made with another configuration; use that one or another --out")
        if saved.data != self.data_name and not saved.data.startswith(f"{self.data_name}{BEGUN_FROM}"):
            raise TrainingError(
                f"the checkpoint was made with {saved.data}, not with {self.data_name}; use that data or another --out"
            )
        self.network.load_state_dict(saved.network)
        self.ema.load(saved.ema)
        self.optimiser.load_state_dict(saved.optimiser)
        self.step, self.seconds, self.data_name = saved.step, saved.seconds, saved.data

    def begin_from(self, other: Beginning) -> None:
        """Start at step 0 with these weights, another task's too: a navigation begins with a chase's trajectories, and
        a chase with a navigation's. Inputs of the state that the other did not have begin without weight. Raises
        `TrainingError` if the networks have other widths.
        """
        own = {name: value.cpu() for name, value in self.network.state_dict().items()}
        theirs = dict(other.weights)
        try:
            theirs["head1.weight"] = other.head_for(self.config)
            for name in ("out.weight", "out.bias"):  # trajectories first, then what detects the target
                theirs[name] = torch.cat([theirs[name], own[name][len(theirs[name]) :]])[: len(own[name])]
            self.network.load_state_dict(theirs)
        except (KeyError, RuntimeError) as error:
            raise TrainingError("what it is to begin from is another network; use the same widths") from error
        if other.folded:
            rng = np.random.default_rng([self.config.seed, 3])
            index = rng.choice(len(self.frames), min(NORMALISING_FRAMES, len(self.frames)), replace=False)
            batch = batches.make_batch(self.frames, index, rng, self.config, training=True, device=self.workers.device)
            normalise(self.network, batch.rgbd_I4HW)
        self.ema = Ema(self.network, self.config.training.ema)
        self.data_name += f"{BEGUN_FROM}{other.origin}"

    def indices(self, step: int) -> np.ndarray:
        """The frames of a step, of all processes together."""
        epoch, position = divmod(step, self.steps_per_epoch)
        if self._order[0] != epoch:
            self._order = (epoch, batches.epoch_order(len(self.frames), seed=self.config.seed, epoch=epoch))
        batch = self.config.training.batch
        return self._order[1][position * batch : (position + 1) * batch]

    def _batch(self, step: int) -> Batch:
        """This process's part of a step."""
        if self._ahead and self._ahead[0] == step:
            return self._ahead[1]
        config = self.config
        return batches.make_batch(
            self.frames,
            self.indices(step),
            np.random.default_rng([config.seed, 2, step]),
            config,
            training=True,
            states=config.training.states,
            part=self.workers.part(config.training.batch),
            device=self.workers.device,
        )

    def _together(self, outcome: Outcome, share: float) -> dict[str, torch.Tensor]:
        """Sum up what the processes have of the gradients, and of the loss and its parts, which are returned. `share`
        is this process's of the step's images."""
        parts = {name: value.detach() * share for name, value in outcome.parts.items()}
        if self.workers.count == 1:
            return parts
        positives = outcome.assignment.positive_BN.sum().float()
        if "target" in parts:  # a mean over the positives, not over all
            parts["target"] = outcome.parts["target"].detach() * positives
        gradients = [p.grad for p in self.network.parameters() if p.grad is not None]
        self.workers.total([*gradients, *parts.values(), positives])
        if "target" in parts:
            parts["target"] /= positives.clamp_min(1)
        return parts

    def advance(self) -> dict[str, torch.Tensor]:
        """One optimiser step; returns the loss and its parts. Raises `TrainingError` on a non-finite loss."""
        started, training = time.monotonic(), self.config.training
        batch = self._batch(self.step)
        rate = learning_rate(
            self.step,
            total=self.total_steps,
            warm_up=max(1, min(round(training.warm_up_epochs * self.steps_per_epoch), self.total_steps // 10)),
            peak=training.learning_rate,
            final_fraction=training.final_fraction,
        )
        for group in self.optimiser.param_groups:
            group["lr"] = rate
        self.network.train()
        with torch.autocast(self.workers.device.type, dtype=torch.bfloat16, enabled=self.bf16):
            features = self.network.features(batch.rgbd_I4HW)
        # The backbone costs most and does not see the state: several states for an image are nearly free.
        features = features.float().repeat_interleave(training.states, dim=0)
        outcome = self.losses(self.network.head(features, batch.state_BS), batch)
        self.optimiser.zero_grad(set_to_none=True)
        share = len(batch.rgbd_I4HW) / training.batch
        (outcome.loss * share).backward()
        parts = self._together(outcome, share)
        norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), training.gradient_norm_max)
        self._ahead = (self.step + 1, self._batch(self.step + 1))  # a GPU is still at this one
        if not torch.isfinite(norm):
            raise TrainingError(f"step {self.step}: loss or gradient is not finite; resume from the last checkpoint")
        self.optimiser.step()
        self.ema.update(self.step)
        self.step += 1
        self.seconds += time.monotonic() - started
        return {**parts, "gradient_norm": norm, "learning_rate": torch.tensor(rate)}


class _StopFlag:
    """Set by Ctrl-C or a termination signal while it is entered; a second one is not caught."""

    def __enter__(self) -> Self:
        self.raised = False
        self.before = {number: signal.signal(number, self._set) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_error: object) -> None:
        for number, handler in self.before.items():
            signal.signal(number, handler)

    def _set(self, number: int, _frame: FrameType | None) -> None:
        self.raised = True
        signal.signal(number, signal.SIG_DFL)


def keep_freed_memory() -> None:
    """Tell glibc to keep freed memory for the next step instead of giving it back to the system.

    A step allocates and frees the same large tensors again and again; faulting their pages in anew costs about 40 % of
    a step on a CPU. Elsewhere than on glibc this does nothing.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        trim_threshold, mmap_max = -1, -4  # M_TRIM_THRESHOLD, M_MMAP_MAX of malloc.h
        mallopt(mmap_max, 0)
        mallopt(trim_threshold, 2**31 - 1)


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """What a run does beside its steps."""

    also: tuple[Path, ...] = ()
    """More data sets to train on: images are drawn from all alike."""
    validation: Path | None = None
    """Data set of other scenes."""
    stream: bool = False
    """Whether the images stay on disk until a step needs them."""
    resume: bool = False
    begin: Path | None = None
    """A run's folder or a policy's file, whose weights are the first; a resumed run no longer needs it."""
    simulator: Path | None = None
    """The `goshawk-sim` that flies the score's campaigns; needs `validation`, which gives the costs' scale."""
    score_minutes: float = 30.0


def run(config: Config, root: Path, out: Path, options: RunOptions) -> bool:
    """Train and leave `checkpoint.pt` and TensorBoard events in `out`; whether the end was reached before a signal.

    Under `torchrun` the processes share each step's `batch` images, and do what one alone would; the first one prints
    and writes. A run goes on with another number of them.
    """
    if options.simulator and not options.validation:
        raise TrainingError("a score needs the costs' scale, which held-out scenes give; add --validation")
    keep_freed_memory()
    torch.set_num_threads(config.training.threads)
    sets = (root, *options.also)
    workers = join()
    try:
        saved, begun = workers.agree(lambda: _before(out / checkpoint.FILE, options))
        for each in sets:
            scene_folders(each)  # without any, every process says so, and none waits
        if workers.first:
            print(f"loading {', '.join(map(str, sets))}", flush=True)
        frames, maps = workers.one_by_one(lambda: batches.load(root, config, also=options.also, stream=options.stream))
        name = "; ".join(describe(each) for each in sets)
        if workers.agree(lambda: (name, len(frames))) != (name, len(frames)):
            raise TrainingError(f"process {workers.rank} finds other data than the first: {name}; copy the same to all")
        trainer = Trainer(config, frames, maps, data_name=name, workers=workers)
        if saved:
            trainer.restore(saved)
        elif begun:
            trainer.begin_from(begun)
        return _steps(trainer, out, options)
    finally:
        leave()


def _before(path: Path, options: RunOptions) -> tuple[Checkpoint | None, Beginning | None]:
    """The checkpoint to go on from, or the weights to begin with."""
    if path.exists() and options.resume:
        return checkpoint.load(path), None
    if path.exists():
        raise TrainingError(f"{path} exists; add --resume to go on, or choose another --out")
    return None, _beginning(options.begin) if options.begin else None


def _beginning(path: Path) -> Beginning:
    return of_policy(path) if path.suffix == ".onnx" else of_run(path / checkpoint.FILE)


def _steps(trainer: Trainer, out: Path, options: RunOptions) -> bool:
    with _StopFlag() as stop:
        clerk = _Clerk(trainer, out, options, stop) if trainer.workers.first else None
        while trainer.step < trainer.total_steps and not trainer.workers.any(stop.raised):
            parts = trainer.advance()
            if clerk:
                clerk.after_step(parts)
        if clerk:
            clerk.close()
    if clerk and stop.raised:
        print(f"stopped at step {trainer.step}; {clerk.path} is written, go on with --resume", file=sys.stderr)
    return trainer.step == trainer.total_steps


class _Clerk:
    """Prints, writes and measures, each in its time."""

    def __init__(self, trainer: Trainer, out: Path, options: RunOptions, stop: _StopFlag) -> None:
        self.trainer, self.options, self.stop, self.path = trainer, options, stop, out / checkpoint.FILE
        self.held_out = validate.Validator(trainer.config, options.validation) if options.validation else None
        out.mkdir(parents=True, exist_ok=True)
        self.log, self.report = SummaryWriter(str(out)), _Report(trainer)
        self.saved = self.checked = self.scored = time.monotonic()
        batch, workers = trainer.config.training.batch, trainer.workers
        together = f", {workers.count} processes" if workers.count > 1 else ""
        print(
            f"{len(trainer.frames)} frames, {parameter_count(trainer.network):,} parameters, "
            f"steps {trainer.step}..{trainer.total_steps} of {batch} on {workers.device}{together}",
            flush=True,
        )

    def after_step(self, parts: dict[str, torch.Tensor]) -> None:
        """Whatever is due after a step."""
        trainer, training, now = self.trainer, self.trainer.config.training, time.monotonic()
        self.report.add(parts, self.log)
        last = trainer.step == trainer.total_steps
        check = self.held_out and (last or now - self.checked > training.validate_minutes * 60)
        fly = self.options.simulator and (last or now - self.scored > self.options.score_minutes * 60)
        if check or fly or now - self.saved > training.checkpoint_minutes * 60:
            checkpoint.save(self.path, trainer.snapshot())
            self.saved = now
        if self.held_out and check:
            self._say("validation", self.held_out.evaluate_state(trainer.snapshot()))
            self.checked = time.monotonic()
        if self.held_out and self.options.simulator and fly and not self.stop.raised:
            self._score(self.options.simulator, self.held_out)
            self.scored = time.monotonic()

    def _score(self, simulator: Path, held_out: validate.Validator) -> None:
        """A score that fails is a line, for it says nothing of the training."""
        trainer, threads = self.trainer, self.trainer.config.training.threads
        try:
            flown = score.score(
                trainer.snapshot(), simulator, held_out, threads=threads, stopped=lambda: self.stop.raised
            )
        except (TrainerError, OSError) as error:
            if not self.stop.raised:
                print(f"no score at step {trainer.step}: {error}", file=sys.stderr)
            return
        self._say("score", flown)

    def _say(self, group: str, figures: dict[str, float]) -> None:
        for name, value in figures.items():
            self.log.add_scalar(f"{group}/{name}", value, self.trainer.step)
        print(validate.table(figures), flush=True)

    def close(self) -> None:
        """The last state goes to disk."""
        checkpoint.save(self.path, self.trainer.snapshot())
        self.log.close()


class _Report:
    """Means over some steps, to the terminal and TensorBoard."""

    EVERY = 100

    def __init__(self, trainer: Trainer) -> None:
        self.trainer = trainer
        self._begin()

    def _begin(self) -> None:
        self.sums: dict[str, float] = {}
        self.started, self.count = time.monotonic(), 0

    def add(self, parts: dict[str, torch.Tensor], log: SummaryWriter) -> None:
        """Count one step in."""
        for name, value in parts.items():
            self.sums[name] = self.sums.get(name, 0.0) + float(value)
        self.count += 1
        trainer = self.trainer
        if trainer.step % self.EVERY and trainer.step != trainer.total_steps:
            return
        means = {name: value / self.count for name, value in self.sums.items()}
        rate = self.count * trainer.config.training.batch / (time.monotonic() - self.started)
        left_min = (trainer.total_steps - trainer.step) * trainer.config.training.batch / rate / 60
        for name, value in {**means, "samples_per_s": rate}.items():
            log.add_scalar(f"train/{name}", value, trainer.step)
        detail = " ".join(f"{n} {v:.3g}" for n, v in means.items() if n != "learning_rate")
        print(
            f"step {trainer.step}/{trainer.total_steps} {rate:.0f} samples/s, {left_min:.0f} min left | {detail}",
            flush=True,
        )
        self._begin()
