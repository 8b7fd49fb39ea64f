"""Some steps of a run by as many processes as `torchrun` started: CONFIG DATA RUN STEPS. It goes on from RUN's
checkpoint if there is one, and writes it.

The backbone computes in double precision. In single precision two orders of a sum give gradients that differ visibly:
a rectifier that opens in one of them and not in the other passes all of its gradient on.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import torch
from goshawk_train.config import Config, load_config
from goshawk_train.data import batches
from goshawk_train.model import checkpoint
from goshawk_train.run import train, workers
from torch import Tensor


def advance(
    config: Config, data: Path, run: Path, steps: int, here: workers.Workers = train.ALONE
) -> dict[str, dict[str, Tensor]]:
    """Gradients and logged figures of the last step."""
    trainer = train.Trainer(config, *here.one_by_one(lambda: batches.load(data, config)), data_name="", workers=here)
    for part in (trainer.network.stem, trainer.network.blocks):
        part.double()

    def to_double(_stem: torch.nn.Module, inputs: tuple[Tensor]) -> tuple[Tensor]:
        return (inputs[0].double(),)

    trainer.network.stem.register_forward_pre_hook(to_double)
    trainer.ema = checkpoint.Ema(trainer.network, config.training.ema)
    path = run / checkpoint.FILE
    saved = here.agree(lambda: checkpoint.load(path) if path.exists() else None)
    if saved:
        trainer.restore(saved)
    parts: dict[str, Tensor] = {}
    for _ in range(steps):
        parts = trainer.advance()
    gradients = {name: p.grad for name, p in trainer.network.named_parameters() if p.grad is not None}
    if here.first:
        checkpoint.save(path, trainer.snapshot())
    return {"gradients": gradients, "parts": parts}


def main(configuration: str, data: str, run: str, steps: str) -> None:
    """What `torchrun` starts."""
    torch.set_num_threads(1)
    here = workers.join()
    found: dict[str, Any] = advance(load_config(Path(configuration)), Path(data), Path(run), int(steps), here)
    if here.first:
        torch.save(found, Path(run) / "step.pt")
    assert here.any(here.rank == here.count - 1) and not here.any(False)
    workers.leave()


if __name__ == "__main__":
    main(*sys.argv[1:])
