"""How fast training is, against the same network trained plainly: one state with each image, as the paper does, default
memory layout, optimiser and allocator. Counted in samples, an image with a state."""

from __future__ import annotations

import subprocess
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import torch

from goshawk_train.config import load_config, replace_training
from goshawk_train.data import batches
from goshawk_train.errors import TrainerError
from goshawk_train.run import train

KEY, TARGET = "training_speedup", 3.5
WARM_UP, STEPS, ROUNDS = 2, 8, 3


class BenchError(TrainerError):
    """The images cannot be made; the message is the simulator's."""


def sample_seconds(root: Path, config_file: Path, *, plain: bool) -> float:
    """Median time of a training step in this process, for each of its samples."""
    config = replace_training(load_config(config_file), threads=1)
    if plain:
        config = replace_training(config, states=1, bf16=False)
    torch.set_num_threads(1)
    if not plain:
        train.keep_freed_memory()
    frames, maps = batches.load(root, config)
    trainer = train.Trainer(config, frames, maps, data_name="bench")
    if plain:
        trainer.network.to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]
        trainer.optimiser = torch.optim.AdamW(trainer.network.parameters(), foreach=False, fused=False)
    seconds: list[float] = []
    for _ in range(WARM_UP + STEPS):
        begun = time.perf_counter()
        trainer.advance()
        seconds.append(time.perf_counter() - begun)
    return float(np.median(seconds[WARM_UP:])) / (config.training.batch * config.training.states)


def measure(simulator: Path, config_file: Path) -> dict[str, float]:
    """Samples a second of both, each in processes of its own, in turns, and their ratio."""
    with tempfile.TemporaryDirectory() as folder:
        made = [str(simulator), "dataset", "--out", folder, "--scenes", "4", "--frames", "64", "--threads", "1"]
        done = subprocess.run(made, capture_output=True, text=True, check=False)
        if done.returncode:
            raise BenchError(f"{simulator} dataset failed: {(done.stderr.strip() or 'no message').splitlines()[-1]}")
        times: dict[bool, list[float]] = {True: [], False: []}
        for _ in range(ROUNDS):
            for plain, seen in times.items():
                with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
                    seen.append(process.submit(sample_seconds, Path(folder), config_file, plain=plain).result())
    plainly, ours = (float(np.median(seen)) for seen in times.values())
    return {"ratio": plainly / ours, "plain_samples_per_s": 1 / plainly, "samples_per_s": 1 / ours}
