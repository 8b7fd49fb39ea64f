"""A checkpoint's score: small campaigns in closed loop, since a lower loss is not always a better flight."""

from __future__ import annotations

import json
import subprocess
import tempfile
from pathlib import Path

from goshawk_train.errors import TrainerError
from goshawk_train.model import export
from goshawk_train.model.checkpoint import Checkpoint
from goshawk_train.run.validate import Validator

TRIALS = 20
SEED = 4_000_001
"""Forests of their own, so that what is chosen by score is judged by others."""
CELLS = {"track": [4.0, 7.0], "navigate": [6.0, 10.0]}
"""Speeds of the target and of the vehicle, m/s."""
SPACING_M = 4.0


class ScoreError(TrainerError):
    """The campaign could not be flown; the message says why."""


def score(
    saved: Checkpoint, simulator: Path, held_out: Validator, *, trials: int = TRIALS, threads: int = 0
) -> dict[str, float]:
    """Share of successes in each cell, and of all, flown by `goshawk-sim` with the averaged weights.

    A tracking run is scored in both tasks. The held-out scenes give the scale of its costs. Raises `ScoreError` if the
    simulator cannot be run.
    """
    shares: dict[str, float] = {}
    scale = held_out.cost_scale(saved)
    with tempfile.TemporaryDirectory() as folder:
        if saved.config.task == "track":
            shares |= _fly(saved, scale, simulator, Path(folder), trials, threads)
            saved = export.for_navigation(saved)
        shares |= _fly(saved, scale, simulator, Path(folder), trials, threads)
    return {**shares, "all": sum(shares.values()) / len(shares)}


def _fly(saved: Checkpoint, scale: float, simulator: Path, folder: Path, trials: int, threads: int) -> dict[str, float]:
    task = saved.config.task
    policy, report = folder / f"{task}.onnx", folder / f"{task}.json"
    export.export(saved, policy, commit=export.current_commit(), cost_scale=scale)
    speeds = ",".join(str(speed) for speed in CELLS[task])
    command = [
        *(str(simulator), "fly", "--task", task, "--policy", str(policy), "--speed", speeds),
        *("--trials", str(trials), "--seed", str(SEED), "--spacing", str(SPACING_M), "--threads", str(threads)),
        *("--json", str(report)),
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise ScoreError(f"cannot run {simulator}: {error.strerror}; build it with `make build`") from error
    if done.returncode:
        last = (done.stderr.strip() or "no message").splitlines()[-1]
        raise ScoreError(f"{' '.join(command[:4])} failed: {last}")
    cells = json.loads(report.read_text())["cells"]
    return {f"{task}_{cell['speed_mps']:g}": cell["successes"] / cell["trials"] for cell in cells}
