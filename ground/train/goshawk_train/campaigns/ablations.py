"""What matters: trainings from nothing that differ in one thing, each flown in the same small campaigns.

`configs/ablations.toml` lists them. A change that was trained and flown is not trained again, a training that was
stopped is gone on with, and several processes may share the work (`--only`).
"""

from __future__ import annotations

import json
import re
import subprocess
import tomllib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from goshawk_train.campaigns.flights import (
    FlightsError,
    Row,
    failures,
    fly,
    read_report,
    read_rows,
    refuse_unknown,
    whole,
    write_whole,
)
from goshawk_train.config import Config, ConfigError, config_from_dict, config_to_dict, load_config

MARKS = ("<!-- ablations: begin -->", "<!-- ablations: end -->")
METRICS = ("collide_cheapest", "aim_missed_p50", "cost_rank", "recall", "false_alarm_empty", "lateral_error_p50")
"""Of the held-out scenes, what the table shows (`validate`)."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """One training: what differs from the configuration."""

    name: str
    set: dict[str, Any] = field(default_factory=dict[str, Any])
    """Fields of the configuration, by their dotted names."""
    scenes: int | None = None
    """Of the data set, instead of the plan's."""

    @property
    def slug(self) -> str:
        """The name, for files."""
        return re.sub(r"[^a-z0-9.]+", "-", self.name.lower()).strip("-")

    def apply(self, config: Config) -> Config:
        """The configuration with this change; raises `ConfigError` for a field that there is not."""
        table = config_to_dict(config)
        for name, value in self.set.items():
            *path, last = name.split(".")
            part: Any = table
            for key in path:
                part = _table(part).get(key)
            if last not in _table(part):
                raise ConfigError(f"{self.name}: there is no field {name}")
            part[last] = value
        return config_from_dict(table)


def _table(value: Any) -> dict[str, Any]:
    return cast("dict[str, Any]", value) if isinstance(value, dict) else {}


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What all trainings share."""

    config: Config
    samples: int
    scenes: int
    frames: int
    trials: int
    seed: int
    campaigns: list[Row]
    changes: list[Change]

    def only(self, names: list[str]) -> Plan:
        """With the named changes alone; raises `FlightsError` for one that there is not."""
        known = {change.slug: change for change in self.changes}
        if unknown := [name for name in names if name not in known]:
            raise FlightsError(f"no change is named {', '.join(unknown)}; there are {', '.join(known)}")
        return replace(self, changes=[known[name] for name in names]) if names else self

    def trained(self, change: Change) -> Config:
        """The configuration of a training; the number of threads is the machine's business."""
        table = config_to_dict(change.apply(self.config))
        table["training"] |= {"samples": self.samples, "threads": 1}
        return config_from_dict(table)


def load(path: Path) -> Plan:
    """The plan in a TOML file; raises `FlightsError`."""
    try:
        table = tomllib.loads(path.read_text())
        counts = ("samples", "scenes", "frames", "trials")
        refuse_unknown(table, {*counts, "seed", "config", "set", "campaign", "change"})
        numbers = {name: whole(table, name) for name in counts} | {"seed": whole(table, "seed", 0)}
        campaigns = read_rows(table["campaign"])
        changes = [Change(**change) for change in table["change"]]
        if len({change.slug for change in changes}) < len(changes):
            raise ValueError("it has two changes of one name: results are kept by it")
        shared = Change(name=path.name, set=table.get("set", {}))
        config = shared.apply(load_config(path.parent / table["config"]))
        plan = Plan(config=config, campaigns=campaigns, changes=changes, **numbers)
        for change in changes:
            plan.trained(change)
    except (OSError, tomllib.TOMLDecodeError, ConfigError, KeyError, AttributeError, TypeError, ValueError) as error:
        raise FlightsError(f"{path} lists no ablations: {error}") from error
    return plan


def data_set(simulator: Path, folder: Path, *, scenes: int, frames: int, seed: int) -> Path:
    """A data set of the simulator, made or gone on with; finished scenes are kept."""
    command = [str(simulator), "dataset", "--out", str(folder), "--scenes", str(scenes), "--frames", str(frames)]
    try:
        made = subprocess.run([*command, "--seed", str(seed)], check=False).returncode == 0
    except OSError as error:
        raise FlightsError(f"cannot run {simulator}: {error.strerror}; build it with `make build`") from error
    if not made:
        raise FlightsError(f"{folder}: the data set was not made; the message is above")
    return folder


def kept(plan: Plan, change: Change, folder: Path) -> dict[str, Any] | None:
    """What this very training flew before, if it did."""
    path = folder / f"{change.slug}.json"
    if not path.exists():
        return None
    result = read_report(path, "identity", "cells", "metrics")
    return result if result["identity"] == identity(plan, change) else None


def identity(plan: Plan, change: Change) -> dict[str, Any]:
    """What a result depends on, besides the simulator."""
    campaigns = [row.arguments(plan.trials, plan.seed) + row.scan for row in plan.campaigns]
    config = json.loads(json.dumps(config_to_dict(plan.trained(change))))
    return {"config": config, "scenes": change.scenes or plan.scenes, "frames": plan.frames, "campaigns": campaigns}


def carry_out(plan: Plan, change: Change, folder: Path, runs: Path, simulator: Path) -> dict[str, Any] | None:
    """Train and fly one change, and keep what came of it in `folder`; None if a signal stopped the training."""
    from goshawk_train.model import checkpoint, export
    from goshawk_train.model.network import Policy, parameter_count
    from goshawk_train.run import train, validate

    if known := kept(plan, change, folder):
        return known
    scenes = change.scenes or plan.scenes
    data = data_set(simulator, runs / f"data-{scenes}", scenes=scenes, frames=plan.frames, seed=900_000)
    held_out = data_set(simulator, runs / "data-validation", scenes=12, frames=plan.frames, seed=900_001)
    config, out = plan.trained(change), runs / change.slug
    print(f"{change.name}: {out}", flush=True)
    if not train.run(config, data, out, train.RunOptions(resume=True)):
        return None
    saved = checkpoint.load(out / checkpoint.FILE)
    network = Policy(saved.config)
    checkpoint.load_weights(network, saved)
    validator = validate.Validator(saved.config, held_out)
    metrics = validator.evaluate(network)
    commit, scale = export.current_commit(), validator.cost_scale(saved)
    export.export(saved, out / "track.onnx", commit=commit, cost_scale=scale)
    if any(row.task == "navigate" for row in plan.campaigns):
        export.export(export.for_navigation(saved), out / "navigate.onnx", commit=commit, cost_scale=scale)
    reports = [
        fly(row, out, simulator, out, trials=plan.trials, seed=plan.seed, seeds="tuning") for row in plan.campaigns
    ]
    result = {
        "identity": identity(plan, change),
        "data": saved.data,
        "hours": round(saved.seconds / 3600, 3),
        "parameters": parameter_count(network),
        "metrics": metrics,
        "cells": [cell for report in reports for cell in report["cells"]],
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / f"{change.slug}.json", json.dumps(result, indent=1) + "\n")
    return result


def markdown(plan: Plan, results: list[tuple[Change, dict[str, Any]]]) -> str:
    """The table of all changes that are flown: successes by cell, their sum, and figures of held-out scenes."""
    if not results:
        return "None is trained yet."
    cells = results[0][1]["cells"]
    head = [
        *(f"{cell['task']} {cell['speed_mps']:g} m/s" for cell in cells),
        "all",
        "failures",
        *METRICS,
    ]
    lines = [f"| change | {' | '.join(head)} |", "|---" * (len(head) + 1) + "|"]
    for change, result in results:
        flown = [f"{cell['successes']}" for cell in result["cells"]]
        total = sum(cell["successes"] for cell in result["cells"])
        trials = sum(cell["trials"] for cell in result["cells"])
        found: dict[str, float] = result["metrics"]  # without those that no frame tells, as of a target in navigation
        metrics = [f"{found[name]:.3g}" if name in found else "–" for name in METRICS]
        row = [*flown, f"{total} of {trials}", failures(result["cells"]), *metrics]
        lines.append(f"| {change.name} | {' | '.join(row)} |")
    return "\n".join(lines)
