"""What a run leaves on disk, so that it can go on exactly where it stopped: one file, replaced atomically."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from goshawk_train.config import Config, config_from_dict, config_to_dict
from goshawk_train.errors import TrainerError

FILE = "checkpoint.pt"
"""Its name in the folder of its run."""


class CheckpointError(TrainerError):
    """A checkpoint that cannot be used; the message names the file and what to do."""


class Ema:
    """Exponential moving average of all floating-point values of a network, its statistics included."""

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.decay = decay
        self.source = [t for t in network.state_dict(keep_vars=True).values() if t.is_floating_point()]
        self.names = [n for n, t in network.state_dict().items() if t.is_floating_point()]
        self.average = [t.detach().clone() for t in self.source]

    def update(self, step: int) -> None:
        """Move towards the network; faster in the first steps, when the average is still the initial values."""
        decay = min(self.decay, (1 + step) / (10 + step))
        with torch.no_grad():
            for average, value in zip(self.average, self.source, strict=True):
                average.lerp_(value.detach(), 1 - decay)

    def state_dict(self) -> dict[str, Tensor]:
        """The averaged values by name."""
        return dict(zip(self.names, self.average, strict=True))

    def load(self, state: dict[str, Tensor]) -> None:
        """Restore what `state_dict` gave."""
        for name, value in zip(self.names, self.average, strict=True):
            value.copy_(state[name])


@dataclass(frozen=True, kw_only=True)
class Checkpoint:
    """A run at one step."""

    config: Config
    step: int
    seconds: float
    """Training time so far."""
    data: str
    network: dict[str, Tensor]
    ema: dict[str, Tensor]
    optimiser: dict[str, Any]
    hardware: str = "hardware that was not recorded"
    """What it was computed on, last."""


def save(path: Path, checkpoint: Checkpoint) -> None:
    """Write beside and rename: a crash leaves the old file or the new one. Raises `CheckpointError` or `OSError`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".partial")
    content = {**checkpoint.__dict__, "config": config_to_dict(checkpoint.config), "format": 1}
    try:
        with temporary.open("wb") as file:
            torch.save(content, file)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except RuntimeError as error:  # what torch makes of a disk that becomes full
        raise CheckpointError(f"{path} cannot be written, and is as it was: make room on its disk") from error
    finally:
        temporary.unlink(missing_ok=True)


def load(path: Path) -> Checkpoint:
    """Read a run's checkpoint; raises `CheckpointError`."""
    _check_there(path)
    try:
        content = torch.load(path, weights_only=True)
        form = content.pop("format", None)
    except Exception as error:
        raise CheckpointError(
            f"{path} cannot be read as a checkpoint ({' '.join(str(error).split())}); name another run, or remove the "
            "file and train anew"
        ) from error
    if form != 1:
        raise CheckpointError(f"{path} has another format than this version's")
    content["config"] = config_from_dict(content["config"])
    return Checkpoint(**content)


def _check_there(path: Path) -> None:
    folder = path.parent
    trains = f"`goshawk train run --out {folder}` makes one"
    if not folder.exists():
        raise CheckpointError(f"there is no folder {folder}: name that of a run; {trains}")
    if not folder.is_dir():
        raise CheckpointError(f"{folder} is no folder: name that of a run, in which its {FILE} lies")
    if not path.exists():
        raise CheckpointError(f"the folder {folder} holds no {FILE}: name that of a run; {trains}")


def load_weights(network: nn.Module, checkpoint: Checkpoint) -> None:
    """Put the averaged weights into a network."""
    network.load_state_dict({**checkpoint.network, **checkpoint.ema})
