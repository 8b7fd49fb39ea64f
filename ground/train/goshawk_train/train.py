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
from pathlib import Path
from types import FrameType

import numpy as np
import torch
import torch.nn.functional as F
from torch.utils.tensorboard import SummaryWriter

from goshawk_train import checkpoint, data, validate
from goshawk_train.checkpoint import Checkpoint, Ema
from goshawk_train.config import Config, replace_training
from goshawk_train.costs import CostModel
from goshawk_train.dataset.layout import describe
from goshawk_train.esdf import SceneMaps
from goshawk_train.losses import LossModel
from goshawk_train.network import Policy, parameter_count

CHECKPOINT = "checkpoint.pt"


class TrainingError(RuntimeError):
    """Training cannot go on; the message says why and what to do."""


def learning_rate(step: int, *, total: int, warm_up: int, peak: float, final_fraction: float) -> float:
    """Linear warm-up over `warm_up` steps, then a cosine down to `final_fraction` of the peak."""
    if step < warm_up:
        return peak * (step + 1) / warm_up
    progress = min(1.0, (step - warm_up) / max(1, total - warm_up))
    return peak * (final_fraction + (1 - final_fraction) * 0.5 * (1 + math.cos(math.pi * progress)))


class Trainer:
    """A run: network, optimiser, average and data, advanced one step at a time."""

    def __init__(self, config: Config, frames: data.Frames, maps: SceneMaps, *, data_name: str) -> None:
        if len(frames) < config.training.batch:
            raise TrainingError(f"{len(frames)} frames are fewer than one batch of {config.training.batch}")
        torch.manual_seed(config.seed)
        self.config, self.frames, self.data_name = config, frames, data_name
        self.losses = LossModel(config, CostModel(config, maps))
        self.network = Policy(config).to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.optimiser = torch.optim.AdamW(
            self.network.parameters(),
            lr=config.training.learning_rate,
            weight_decay=config.training.weight_decay,
            fused=True,
        )
        self.ema = Ema(self.network, config.training.ema)
        self.steps_per_epoch = len(frames) // config.training.batch
        self.total_steps = math.ceil(config.training.samples / config.training.batch)
        self.step, self.seconds = 0, 0.0
        self._order = (-1, np.zeros(0, dtype=np.int64))

    def snapshot(self) -> Checkpoint:
        """The run as it can be written to disk."""
        return Checkpoint(
            config=self.config,
            step=self.step,
            seconds=self.seconds,
            data=self.data_name,
            network=self.network.state_dict(),
            ema=self.ema.state_dict(),
            optimiser=self.optimiser.state_dict(),
        )

    def restore(self, saved: Checkpoint) -> None:
        """Go on from a checkpoint; raises `TrainingError` if it belongs to another run.

        The length of the run and the threads may differ: the schedule then continues towards the new end.
        """
        training = self.config.training
        if replace_training(saved.config, samples=training.samples, threads=training.threads) != self.config:
            raise TrainingError("the checkpoint was made with another configuration; use that one or another --out")
        self.network.load_state_dict(saved.network)
        self.ema.load(saved.ema)
        self.optimiser.load_state_dict(saved.optimiser)
        self.step, self.seconds, self.data_name = saved.step, saved.seconds, saved.data

    def begin_from(self, other: Checkpoint) -> None:
        """Start at step 0 with another run's averaged weights. Of another task's run, whose head sees and says other
        things, only the backbone is taken; inputs of the head that the other run did not have begin without weight.
        Raises `TrainingError` if not even that fits.
        """
        own = self.network.state_dict()
        theirs = {**other.network, **other.ema}
        missing = own["head1.weight"].shape[1] - theirs["head1.weight"].shape[1]
        if missing > 0:
            theirs["head1.weight"] = F.pad(theirs["head1.weight"], (0, 0, 0, 0, 0, missing))
        fitting = {name: value for name, value in theirs.items() if name in own and value.shape == own[name].shape}
        if not all(name in fitting for name in own if name.startswith(("stem.", "blocks."))):
            raise TrainingError("the run to begin from has another backbone; use the same widths")
        if other.config.task != self.config.task:
            fitting = {name: value for name, value in fitting.items() if not name.startswith(("head", "out."))}
        self.network.load_state_dict({**own, **fitting})
        self.ema = Ema(self.network, self.config.training.ema)
        done = other.step * other.config.training.batch
        self.data_name += f", begun from {done} samples of {other.data}"

    def indices(self) -> np.ndarray:
        """The frames of the current step."""
        epoch, position = divmod(self.step, self.steps_per_epoch)
        if self._order[0] != epoch:
            self._order = (epoch, data.epoch_order(len(self.frames), seed=self.config.seed, epoch=epoch))
        batch = self.config.training.batch
        return self._order[1][position * batch : (position + 1) * batch]

    def advance(self) -> dict[str, torch.Tensor]:
        """One optimiser step; returns the loss and its parts. Raises `TrainingError` on a non-finite loss."""
        started, training = time.monotonic(), self.config.training
        rng = np.random.default_rng([self.config.seed, 2, self.step])
        batch = data.make_batch(self.frames, self.indices(), rng, self.config, training=True)
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
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=training.bf16):
            features = self.network.features(batch.rgbd_B4HW)
        outcome = self.losses(self.network.head(features.float(), batch.state_BS), batch)
        self.optimiser.zero_grad(set_to_none=True)
        outcome.loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), training.gradient_norm_max)
        if not torch.isfinite(norm):
            raise TrainingError(f"step {self.step}: loss or gradient is not finite; resume from the last checkpoint")
        self.optimiser.step()
        self.ema.update(self.step)
        self.step += 1
        self.seconds += time.monotonic() - started
        parts = {name: value.detach() for name, value in outcome.parts.items()}
        return {**parts, "gradient_norm": norm, "learning_rate": torch.tensor(rate)}


class _StopFlag:
    """Set by Ctrl-C or a termination signal; a second one is not caught."""

    def __init__(self) -> None:
        self.raised = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._set)

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


def run(
    config: Config, root: Path, out: Path, *, validation: Path | None, resume: bool, begin: Path | None = None
) -> Checkpoint:
    """Train to the end (or a signal) and leave `checkpoint.pt` and TensorBoard events in `out`.

    `begin` is the folder of a run whose weights are the first; a resumed run no longer needs it.
    """
    keep_freed_memory()
    torch.set_num_threads(config.training.threads)
    path = out / CHECKPOINT
    if path.exists() and not resume:
        raise TrainingError(f"{path} exists; add --resume to go on, or choose another --out")
    begun = checkpoint.load(begin / CHECKPOINT) if begin and not (resume and path.exists()) else None
    print(f"loading {root}", flush=True)
    frames, maps = data.load(root, config)
    trainer = Trainer(config, frames, maps, data_name=describe(root))
    if resume and path.exists():
        trainer.restore(checkpoint.load(path))
    elif begun:
        trainer.begin_from(begun)
    held_out = validate.Validator(config, validation) if validation else None
    print(
        f"{len(frames)} frames, {parameter_count(trainer.network):,} parameters, "
        f"steps {trainer.step}..{trainer.total_steps} of {config.training.batch}",
        flush=True,
    )
    stop = _StopFlag()
    out.mkdir(parents=True, exist_ok=True)
    with SummaryWriter(str(out)) as log:
        saved = checked = time.monotonic()
        report = _Report(trainer)
        while trainer.step < trainer.total_steps and not stop.raised:
            report.add(trainer.advance(), log)
            now = time.monotonic()
            if now - saved > config.training.checkpoint_minutes * 60:
                checkpoint.save(path, trainer.snapshot())
                saved = now
            last = trainer.step == trainer.total_steps
            if held_out and (last or now - checked > config.training.validate_minutes * 60):
                metrics = held_out.evaluate_state(trainer.snapshot())
                for name, value in metrics.items():
                    log.add_scalar(f"validation/{name}", value, trainer.step)
                print(validate.table(metrics), flush=True)
                checked = time.monotonic()
        final = trainer.snapshot()
        checkpoint.save(path, final)
    if stop.raised:
        print(f"stopped at step {trainer.step}; {path} is written, go on with --resume", file=sys.stderr)
    return final


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
