"""Child processes that never outlive the demo: each in its own process group, its output in a file."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

LADDER: tuple[tuple[signal.Signals, float], ...] = (
    (signal.SIGINT, 6.0),
    (signal.SIGTERM, 3.0),
    (signal.SIGKILL, 3.0),
)
"""Signals sent to a child's group, and how long each is given, seconds."""


class Child:
    """One running process."""

    def __init__(self, name: str, command: Sequence[str], output: Path) -> None:
        """Starts it. Raises OSError if it cannot be run or ``output`` cannot be written."""
        self.name = name
        self.output = output
        with output.open("wb") as sink:
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=sink, stderr=subprocess.STDOUT, start_new_session=True
            )

    @property
    def pid(self) -> int:
        """Its process id, which is its group's too."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: ended by that signal."""
        return self._process.poll()

    def signal(self, number: signal.Signals) -> None:
        """Sends to the whole group; a group that is gone is fine."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, number)

    def tail(self, lines: int = 15) -> str:
        """The last lines of its output."""
        with self.output.open("rb") as file:
            file.seek(max(0, self.output.stat().st_size - 200 * lines))
            return "\n".join(file.read().decode(errors="replace").splitlines()[-lines:])


def stop_all(children: Sequence[Child], ladder: Sequence[tuple[signal.Signals, float]] = LADDER) -> None:
    """Stops all together, politely first; returns when none runs, and leaves nothing of their groups behind."""
    for number, patience_s in ladder:
        running = [child for child in children if child.exit_code is None]
        if not running:
            break
        for child in running:
            child.signal(number)
        deadline = time.monotonic() + patience_s
        while time.monotonic() < deadline and any(child.exit_code is None for child in running):
            time.sleep(0.02)
    for child in children:
        child.signal(signal.SIGKILL)
