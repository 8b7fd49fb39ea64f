"""What `goshawk doctor` says: each thing that it looks at is one finding, with what to do."""

from __future__ import annotations

import subprocess
from dataclasses import dataclass
from enum import StrEnum


class State(StrEnum):
    """How a thing is."""

    OK = "ok"
    NOTE = "note"
    """Worth knowing, but nothing is broken."""
    BAD = "bad"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line."""

    name: str
    state: State
    text: str
    todo: str = ""
    """What to do; empty only if all is well."""


def ok(name: str, text: str) -> Finding:
    """All is well."""
    return Finding(name=name, state=State.OK, text=text)


def note(name: str, text: str, todo: str) -> Finding:
    """Nothing is broken, but something is to be known."""
    return Finding(name=name, state=State.NOTE, text=text, todo=todo)


def bad(name: str, text: str, todo: str) -> Finding:
    """It does not work like this."""
    return Finding(name=name, state=State.BAD, text=text, todo=todo)


def output(*command: str) -> str | None:
    """A program's first line of output; None if it cannot be run, fails or hangs."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip().partition("\n")[0]
