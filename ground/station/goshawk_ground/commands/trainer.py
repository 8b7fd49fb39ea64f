"""The trainer's commands under `goshawk`. They are found by name once one is asked for: the station neither imports
the trainer nor needs it, and no other command waits for torch."""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
from collections.abc import Mapping
from typing import Any

import typer
from typer.core import TyperGroup

from goshawk_ground.commands import campaigns
from goshawk_ground.commands.options import NO_REPLY, fail

PACKAGE = "goshawk_train"
SETUP = "the trainer is not installed: make setup-train"
_EXAMPLES = {
    "train": "Typical: goshawk train run --config ground/train/configs/track.toml --data data/train --out runs/track, "
    "then goshawk train export --run runs/track --data data/val --out air/models/track.onnx; make train does it all.",
    "dataset": "Examples: goshawk dataset make --out data/train --scenes 480 | "
    "goshawk dataset check data/train --against data/val | goshawk dataset import SRC --out DIR",
    "campaign": "Examples: goshawk campaign report out.json | goshawk campaign compare | goshawk campaign flights | "
    "goshawk campaign robustness | goshawk campaign ablations | goshawk campaign run PLAN.toml",
}
_HELP = {
    "train": "Train a policy, measure it, and export it for flight.",
    "dataset": "Data sets for training: make one, check it, or import recordings of another layout.",
    "campaign": "Campaigns of many flights: their pages, the flight table, who flies better, and what made it so.",
}


class TrainerGroup(TyperGroup):
    """A group whose commands are its own and the trainer's of the same name."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Its own, then the trainer's; without the trainer the help says how to get it."""
        own = super().list_commands(ctx)
        if not trainer_installed():
            self.epilog = f"{SETUP[0].upper()}{SETUP[1:]}"
            return own
        return own + list(self._trainers().commands)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command; ends with one line if it can only be the trainer's and that is missing."""
        own = super().get_command(ctx, cmd_name)
        if own is not None:
            return own
        if not trainer_installed():
            fail(f"no {self.name} {cmd_name}: {SETUP}", NO_REPLY)
        return self._trainers().get_command(ctx, cmd_name)

    def _trainers(self) -> TyperGroup:
        try:
            module = importlib.import_module(f"{PACKAGE}.commands.{self.name}")
        except ModuleNotFoundError as error:
            fail(f"no {self.name}: {error.name} is not installed: make setup-train", NO_REPLY)
        return typer.main.get_group(module.app)


def trainer_installed() -> bool:
    """Whether this interpreter finds the trainer, without importing it."""
    return importlib.util.find_spec(PACKAGE) is not None


def restart_with(settings: Mapping[str, str]) -> None:
    """Starts this very command again with these environment variables, unless the environment has them all."""
    if any(name not in os.environ for name in settings):
        os.execve(sys.executable, [sys.executable, *sys.orig_argv[1:]], {**settings, **os.environ})


def register(app: typer.Typer) -> None:
    """Adds the groups to the `goshawk` command."""
    for name, text in _HELP.items():
        group = typer.Typer(cls=TrainerGroup, no_args_is_help=True, rich_markup_mode="rich")
        if name == "campaign":
            campaigns.register(group)
        app.add_typer(group, name=name, help=text, epilog=_EXAMPLES[name])
