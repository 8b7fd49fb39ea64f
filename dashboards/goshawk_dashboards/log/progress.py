"""How far long work is, for those who wait for it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

Progress = Callable[[str, int, int], None]
"""Told what is done, how many of it, of how many."""


def unheard(*_: object) -> None:
    """A ``Progress`` that tells nobody."""


@contextmanager
def progress_bar(*, counted: bool = True) -> Generator[Progress]:
    """A bar a kind of work on a terminal, nothing elsewhere; with the counts, or else with the share alone."""
    share = MofNCompleteColumn() if counted else TaskProgressColumn()
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), share, TimeRemainingColumn())
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        tasks: dict[str, TaskID] = {}

        def update(what: str, done: int, total: int) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done, total=total)

        yield update
