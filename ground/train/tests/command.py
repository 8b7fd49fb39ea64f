"""The `goshawk` command as a user meets it, in this process."""

from __future__ import annotations

from goshawk_ground.cli import app
from typer.testing import CliRunner, Result


def goshawk(*arguments: object) -> Result:
    """Its exit status and its words."""
    return CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
