"""The rows of a folder's logs: each log is read once, and again only when its size or its time has changed."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import sqlite3
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

from goshawk_dashboards.log.progress import Progress, unheard
from goshawk_dashboards.report.season.row import Row, row_of, writable

MEANING = 3
"""Raise it when a column's value changes its meaning: what is kept was worked out by the old one."""
_FORMAT = f"{MEANING} {' '.join(field.name for field in fields(Row))}"
_PER_PROCESS = 4
"""Logs for which another process is worth its start."""


class Kept:
    """Rows that were worked out before, in one SQLite file. A folder that cannot be written keeps nothing."""

    def __init__(self, folder: Path) -> None:
        """``folder`` is made if need be."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = sqlite3.connect(folder / "flights.sqlite")
            self._begin()
        except (OSError, sqlite3.Error):
            self._file = sqlite3.connect(":memory:")
            self._begin()

    def _begin(self) -> None:
        self._file.execute("CREATE TABLE IF NOT EXISTS kept (path PRIMARY KEY, stamp, row)")
        self._file.commit()

    def close(self) -> None:
        """Lets go of the file."""
        self._file.close()

    def get(self, path: Path) -> tuple[bool, Row | None]:
        """Whether the log's row is known, and the row; None: the log is another program's."""
        try:
            found = self._file.execute("SELECT stamp, row FROM kept WHERE path = ?", (_key(path),)).fetchone()
        except sqlite3.Error:
            found = None  # what was kept is damaged, or another process holds it: the log is read
        if found is None or found[0] != _stamp(path):
            return False, None
        facts: dict[str, Any] | None = json.loads(found[1])
        if facts is None:
            return True, None
        facts.update(path=str(path), faults=tuple(facts["faults"]))
        return True, Row(**facts)

    def put(self, path: Path, stamp: str, row: Row | None) -> None:
        """Keeps what a log gave that had this stamp when it was read."""
        text = json.dumps(None if row is None else asdict(row))
        try:
            with self._file:
                self._file.execute("REPLACE INTO kept VALUES (?, ?, ?)", (_key(path), stamp, text))
        except sqlite3.Error:
            return  # another process holds it, or the disk is full: it is read again next time


def _key(path: Path) -> str:
    return writable(os.path.realpath(path))


def _stamp(path: Path) -> str:
    """Changes whenever the file does, or who may read it."""
    try:
        facts = path.stat()
    except OSError:
        return ""
    return f"{facts.st_size} {facts.st_mtime_ns} {facts.st_ctime_ns} {_FORMAT}"


def gather(paths: Sequence[Path], cache: Path, progress: Progress = unheard) -> Iterator[Row | None]:
    """A row for each log, in no order, as each is known."""
    with closing(Kept(cache)) as kept:
        unread: list[Path] = []
        for path in paths:
            known, row = kept.get(path)
            if known:
                yield row
            else:
                unread.append(path)
        stamps = [_stamp(path) for path in unread]
        done = len(paths) - len(unread)
        for path, stamp, row in zip(unread, stamps, _read(unread, progress), strict=True):
            kept.put(path, stamp, row)
            done += 1
            progress("logs", done, len(paths))
            yield None if row is None else replace(row, path=str(path))


def _read(paths: Sequence[Path], progress: Progress) -> Iterator[Row | None]:
    processes = min(os.cpu_count() or 1, len(paths) // _PER_PROCESS)
    if processes < 2:
        yield from (row_of(path, progress) for path in paths)
        return
    # Ctrl-C is for the one that waits for them: it lets them finish the log in hand.
    with ProcessPoolExecutor(
        processes, multiprocessing.get_context("spawn"), signal.signal, (signal.SIGINT, signal.SIG_IGN)
    ) as pool:
        try:
            yield from pool.map(row_of, paths)
        finally:
            pool.shutdown(cancel_futures=True)
