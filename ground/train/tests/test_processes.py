"""Several processes under `torchrun` train as one, by Gloo on the CPU: NCCL wants a GPU for each."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import joint_run
import numpy as np
import pytest
import torch
from goshawk_train.config import Config, replace_training
from goshawk_train.data import batches
from goshawk_train.model import checkpoint
from goshawk_train.run.workers import Workers
from synthetic import write_config
from torch import Tensor

GOSHAWK = Path(sys.executable).with_name("goshawk")
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def exact(small: Config) -> Config:
    """Without rounding to bfloat16, by which sums in another order would differ visibly."""
    return replace_training(small, bf16=False, threads=1)


def torchrun(processes: int, *command: object) -> subprocess.CompletedProcess[str]:
    start = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", str(processes)]
    start += ["--rdzv-backend", "c10d", "--rdzv-endpoint", "localhost:0"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    command_line = [*start, *map(str, command)]
    return subprocess.run(command_line, capture_output=True, text=True, env=environment, check=False)


def assert_same(found: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    """Within a 100,000th of the largest value of each tensor: the head computes in single precision."""
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        apart = float((found[name] - value).abs().max() / value.abs().max().clamp_min(1e-12))
        assert apart < 1e-5, f"{name}: {apart:.1e}"


def test_a_run_of_two_processes_is_that_of_one_and_is_gone_on_with_by_one_and_by_three(
    exact: Config, dataset: Path, tmp_path: Path
) -> None:
    """Gradients, losses, batch norms' statistics, weights and averages. The images of three are unequally many."""
    config = write_config(exact, tmp_path)
    runs = {name: tmp_path / name for name in ("one", "two", "three")}
    for folder in runs.values():
        folder.mkdir()

    def joint(processes: int, name: str, steps: int) -> dict[str, dict[str, Tensor]]:
        done = torchrun(processes, HERE / "joint_run.py", config, dataset, runs[name], steps)
        assert done.returncode == 0, done.stderr
        return torch.load(runs[name] / "step.pt", weights_only=True)

    def saved(name: str) -> checkpoint.Checkpoint:
        return checkpoint.load(runs[name] / checkpoint.FILE)

    def assert_step(found: dict[str, dict[str, Tensor]], name: str, expected: dict[str, dict[str, Tensor]]) -> None:
        for group in ("gradients", "parts"):
            assert_same(found[group], expected[group])
        assert_same(saved(name).network, saved("one").network)
        assert_same(saved(name).ema, saved("one").ema)

    assert_step(joint(2, "two", 1), "two", joint_run.advance(exact, dataset, runs["one"], 1))
    (runs["three"] / checkpoint.FILE).write_bytes((runs["two"] / checkpoint.FILE).read_bytes())
    whole = joint_run.advance(exact, dataset, runs["one"], 2)
    assert_step(joint_run.advance(exact, dataset, runs["two"], 2), "two", whole)
    assert_step(joint(3, "three", 2), "three", whole)
    assert saved("three").step == 3


def test_torchrun_starts_the_command_on_a_streamed_set_and_the_first_process_alone_speaks(
    small: Config, dataset: Path, tmp_path: Path
) -> None:
    arguments = ["train", "run", "--config", write_config(small, tmp_path), "--data", dataset]
    arguments += ["--out", tmp_path / "run", "--samples", 16, "--threads", 1, "--stream"]
    done = torchrun(2, "--no-python", GOSHAWK, *arguments)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("steps 0..2 of 8") == 1, done.stdout
    assert checkpoint.load(tmp_path / "run" / checkpoint.FILE).step == 2


def test_each_process_reads_its_part_of_a_step_as_the_whole_has_it(exact: Config, dataset: Path) -> None:
    frames, _ = batches.load(dataset, exact)

    def read(part: slice) -> list[Tensor]:
        rng, index = np.random.default_rng(7), np.arange(3, 11)
        batch = batches.make_batch(frames, index, rng, exact, training=True, states=2, part=part)
        return [batch.rgbd_I4HW, batch.state_BS, batch.target_net_B3, batch.visible_B, batch.situation.scene_B]

    whole = read(slice(None))
    for count in (2, 3, 8):
        parts = [read(Workers(torch.device("cpu"), rank, count).part(8)) for rank in range(count)]
        for position, expected in enumerate(whole):
            assert torch.equal(torch.cat([part[position] for part in parts]), expected), (count, position)


def test_images_that_stay_on_disk_are_those_of_a_set_in_memory(exact: Config, dataset: Path) -> None:
    loaded, streamed = (batches.load(dataset, exact, stream=stream)[0] for stream in (False, True))
    assert len(streamed) == len(loaded) == 24
    backwards = np.arange(23, -1, -1)
    for found, expected in ((streamed.rgb_FHW3, loaded.rgb_FHW3), (streamed.depth_FHW, loaded.depth_FHW)):
        assert np.array_equal(found[backwards], expected[backwards])
        assert np.array_equal(found[12], expected[12]) and np.array_equal(found[:3], expected[:3])
