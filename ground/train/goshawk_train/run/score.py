"""A checkpoint's score: small campaigns in closed loop, since a lower loss is not always a better flight."""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Callable
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
LOOK_S = 0.2
"""How often a score that is flown asks whether it is to stop."""


class ScoreError(TrainerError):
    """The campaign could not be flown; the message says why."""


def score(
    saved: Checkpoint,
    simulator: Path,
    held_out: Validator,
    *,
    trials: int = TRIALS,
    threads: int = 0,
    stopped: Callable[[], bool] = lambda: False,
) -> dict[str, float]:
    """Share of successes in each cell, and of all, flown by `goshawk-sim` with the averaged weights.

    A tracking run is scored in both tasks, unless its state does not tell where to fly. The held-out scenes give the
    scale of its costs. Raises `ScoreError` if the simulator cannot be run, or ends it once `stopped`.
    """
    options = ("--trials", str(trials), "--threads", str(threads))
    shares: dict[str, float] = {}
    scale = held_out.cost_scale(saved)
    with tempfile.TemporaryDirectory() as folder:
        if saved.config.task == "track":
            shares |= _fly(saved, scale, simulator, Path(folder), options, stopped)
        if saved.config.has_goal:
            shares |= _fly(export.for_navigation(saved), scale, simulator, Path(folder), options, stopped)
    return {**shares, "all": sum(shares.values()) / len(shares)}


def _fly(
    saved: Checkpoint,
    scale: float,
    simulator: Path,
    folder: Path,
    options: tuple[str, ...],
    stopped: Callable[[], bool],
) -> dict[str, float]:
    task = saved.config.task
    policy, report = folder / f"{task}.onnx", folder / f"{task}.json"
    export.export(saved, policy, commit=export.current_commit(), cost_scale=scale)
    speeds = ",".join(str(speed) for speed in CELLS[task])
    command = [
        *(str(simulator), "fly", "--task", task, "--policy", str(policy), "--speed", speeds),
        *("--seed", str(SEED), "--spacing", str(SPACING_M), *options, "--json", str(report)),
    ]
    try:
        child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    except OSError as error:
        raise ScoreError(f"cannot run {simulator}: {error.strerror}; build it with `make build`") from error
    said = _last_words(child, stopped)
    if child.returncode:
        raise ScoreError(f"{' '.join(command[:4])} failed: {said}")
    cells = json.loads(report.read_text())["cells"]
    return {f"{task}_{cell['speed_mps']:g}": cell["successes"] / cell["trials"] for cell in cells}


def _last_words(child: subprocess.Popen[str], stopped: Callable[[], bool]) -> str:
    """Of a simulator that has ended; raises `ScoreError` once `stopped`, and leaves none behind."""
    with child:
        try:
            while True:
                try:
                    _, said = child.communicate(timeout=LOOK_S)
                    return (said.strip() or "no message").splitlines()[-1]
                except subprocess.TimeoutExpired:
                    if stopped():
                        raise ScoreError("stopped before its end") from None
        finally:
            child.kill()
