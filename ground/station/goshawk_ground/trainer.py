"""Runs the trainer's commands beside the station: another process, so that the station never imports it."""

from __future__ import annotations

import importlib.util
import signal
import subprocess
import sys
from collections.abc import Sequence

MODULE = "goshawk_train"


def trainer_installed() -> bool:
    """Whether this interpreter finds the trainer, without importing it."""
    return importlib.util.find_spec(MODULE) is not None


def run_trainer(arguments: Sequence[str]) -> int:
    """The trainer's command with this terminal as its own; returns its exit status, as a shell would."""
    with subprocess.Popen([sys.executable, "-m", MODULE, *arguments]) as child:
        # Ctrl-C reaches both: the trainer decides what becomes of it, and is waited for.
        before = signal.signal(signal.SIGINT, signal.SIG_IGN)
        try:
            status = child.wait()
        finally:
            signal.signal(signal.SIGINT, before)
    return status if status >= 0 else 128 - status
