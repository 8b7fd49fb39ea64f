"""The process of a command: what it is started with, and how it ends."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager
from typing import NoReturn

import typer

from goshawk_train.errors import TrainerError

UNUSABLE, INTERRUPTED = 2, 130
SETTINGS = {"OMP_WAIT_POLICY": "PASSIVE", "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1"}
"""Two settings decide the speed of training on a CPU: how threads wait (spinning ones starve each other beside other
work: measured 2-4 x) and huge pages for the tensors that come and go each step (measured 1.3 x)."""


def start_for_training(context: typer.Context) -> None:
    """Start the process anew with `SETTINGS`, which are read before Python's first line. The `goshawk` command brings
    the way to do so; where a test calls, there is none, and the process stays as it is."""
    if context.obj is not None:
        context.obj(SETTINGS)


def end(status: int) -> NoReturn:
    """End the command with this exit status."""
    if int(os.environ.get("WORLD_SIZE", "1")) > 1:
        # One of several workers: threads of the process group may still let go of tensors, which aborts a process whose
        # interpreter is on its way out (pytorch/pytorch#179291). All files are closed by now.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    raise typer.Exit(status)


@contextmanager
def ends_in_one_line(context: typer.Context, interrupted: str = "what is finished is kept") -> Generator[None]:
    """What is wrong becomes one line and an exit status; a termination signal ends like Ctrl-C, a simulator that the
    command runs with it."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    except TrainerError as error:
        _fail(context, str(error), UNUSABLE)
    except ModuleNotFoundError as error:
        _fail(context, f"{error.name} is not installed: make setup-train", UNUSABLE)
    except OSError as error:
        _fail(context, f"{error.filename}: {error.strerror}" if error.filename else str(error), UNUSABLE)
    except KeyboardInterrupt:
        _fail(context, f"interrupted; {interrupted}", INTERRUPTED)
    finally:
        signal.signal(signal.SIGTERM, before)


def _fail(context: typer.Context, text: str, status: int) -> NoReturn:
    print(f"{context.command_path}: {text}", file=sys.stderr)
    end(status)
