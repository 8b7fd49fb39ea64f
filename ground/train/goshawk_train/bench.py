"""How fast training is, against the same network trained plainly: one state with each image, as the paper does, default
memory layout, optimiser and allocator. Counted in samples, an image with a state."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch

from goshawk_train import data, train
from goshawk_train.config import load_config, replace_training

KEY, TARGET = "training_speedup", 2.0
WARM_UP, STEPS, ROUNDS = 2, 8, 3


def sample_seconds(root: Path, config_file: Path, *, plain: bool) -> float:
    """Median time of a training step in this process, for each of its samples."""
    config = replace_training(load_config(config_file), threads=1)
    if plain:
        config = replace_training(config, states=1, bf16=False)
    torch.set_num_threads(1)
    if not plain:
        train.keep_freed_memory()
    frames, maps = data.load(root, config)
    trainer = train.Trainer(config, frames, maps, data_name="bench")
    if plain:
        trainer.network.to(memory_format=torch.contiguous_format)  # type: ignore[call-overload]
        trainer.optimiser = torch.optim.AdamW(trainer.network.parameters(), foreach=False, fused=False)
    seconds = []
    for _ in range(WARM_UP + STEPS):
        begun = time.perf_counter()
        trainer.advance()
        seconds.append(time.perf_counter() - begun)
    return float(np.median(seconds[WARM_UP:])) / (config.training.batch * config.training.states)


def measure(simulator: Path, config_file: Path) -> dict[str, float]:
    """Samples a second of both, each in processes of its own, in turns, and their ratio."""
    with tempfile.TemporaryDirectory() as folder:
        made = [str(simulator), "dataset", "--out", folder, "--scenes", "4", "--frames", "64", "--threads", "1"]
        subprocess.run(made, check=True, capture_output=True)
        times: dict[str, list[float]] = {"plain": [], "ours": []}
        for _ in range(ROUNDS):
            for kind, seen in times.items():
                command = [sys.executable, "-m", __spec__.name, "--child", kind, "--data", folder]
                done = subprocess.run([*command, "--config", str(config_file)], check=True, capture_output=True)
                seen.append(float(done.stdout))
    plain, ours = (float(np.median(seen)) for seen in times.values())
    return {"ratio": plain / ours, "plain_samples_per_s": 1 / plain, "samples_per_s": 1 / ours}


def main() -> int:
    """Print the figures with their yardstick and add them to `target/bench.json`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulator", type=Path, default=Path("target/release/goshawk-sim"))
    parser.add_argument("--config", type=Path, default=Path("ground/train/configs/track.toml"))
    parser.add_argument("--report", type=Path, default=Path("target/bench.json"))
    parser.add_argument("--child", choices=["plain", "ours"], help=argparse.SUPPRESS)
    parser.add_argument("--data", type=Path, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        print(sample_seconds(args.data, args.config, plain=args.child == "plain"))
        return 0
    found = measure(args.simulator, args.config)
    print(
        f"{KEY}: {found['ratio']:.2f} x plain training (target {TARGET:g}); "
        f"{found['samples_per_s']:.0f} samples/s, plainly {found['plain_samples_per_s']:.0f}, one thread"
    )
    report = json.loads(args.report.read_text()) if args.report.exists() else {}
    args.report.write_text(json.dumps({**report, KEY: {**found, "target": TARGET}}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
