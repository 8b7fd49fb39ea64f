"""CSV: a folder with one file a channel; images as files beside their table.

Columns are the messages' own fields, nested ones joined by a dot, after ``log_time_ns``. What a message holds many of
is a file of its own, a row each, with the parent's time and its index; lists of numbers are one cell, separated by
spaces. An empty cell is an absent value.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from google.protobuf.message import Message

from goshawk_dashboards.exports.source import Record

_TIME = "log_time_ns"
_SUFFIXES = {"rgb_png": "png", "depth_png": "png", "jpeg": "jpg"}


def write_csv(records: Iterable[Record], folder: Path) -> dict[str, int]:
    """Fills ``folder``, which exists and is empty; rows by file. Raises OSError if it cannot be written."""
    with ExitStack() as files:
        tables = _Tables(folder, files)
        for record in records:
            tables.add(record)
        return tables.counts


class _Tables:
    def __init__(self, folder: Path, files: ExitStack) -> None:
        self._folder = folder
        self._files = files
        self._writers: dict[str, Any] = {}
        self.counts: dict[str, int] = {}

    def add(self, record: Record) -> None:
        name = record.topic.replace("/", "_")
        message = record.message
        self._row(name, message.DESCRIPTOR, [record.log_ns], [_TIME], message)
        for field, _ in message.ListFields():
            if field.is_repeated and field.message_type is not None:
                for index, item in enumerate(getattr(message, field.name)):
                    self._row(f"{name}.{field.name}", item.DESCRIPTOR, [record.log_ns, index], [_TIME, "index"], item)

    def _row(self, name: str, kind: Any, keys: list[int], key_names: list[str], message: Message) -> None:
        if name not in self._writers:
            file = self._files.enter_context((self._folder / f"{name}.csv").open("x", newline="", encoding="utf-8"))
            self._writers[name] = csv.writer(file)
            self._writers[name].writerow([*key_names, *_columns(kind)])
            self.counts[f"{name}.csv"] = 0
        row = self.counts[f"{name}.csv"]
        self._writers[name].writerow([*keys, *self._cells(message, f"{name}/{row:06d}")])
        self.counts[f"{name}.csv"] = row + 1

    def _cells(self, message: Message | None, blob: str) -> Iterator[object]:
        """The cells of a message; those of one that is absent are empty. Bytes become the file ``blob``.*."""
        kind = message.DESCRIPTOR if message is not None else None
        if message is None or kind is None:
            return
        for field in kind.fields:
            if field.message_type is not None:
                if not field.is_repeated:
                    present = message.HasField(field.name)
                    empty = [""] * len(list(_columns(field.message_type)))
                    yield from self._cells(getattr(message, field.name), blob) if present else empty
            elif field.has_presence and not message.HasField(field.name):
                yield ""
            else:
                yield self._cell(field, getattr(message, field.name), blob)

    def _cell(self, field: Any, value: Any, blob: str) -> object:
        if field.is_repeated:
            return " ".join(str(item) for item in value)
        if field.enum_type is not None:
            known = field.enum_type.values_by_number.get(value)
            return known.name if known is not None else value
        if isinstance(value, bytes):
            path = self._folder / f"{blob}_{field.name}.{_SUFFIXES.get(field.name, 'bin')}"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(value)
            return path.relative_to(self._folder).as_posix()
        return value


def _columns(kind: Any, prefix: str = "") -> Iterator[str]:
    """Names of a message's cells; ``kind`` is its descriptor, of either of protobuf's two implementations."""
    for field in kind.fields:
        if field.message_type is None:
            yield prefix + field.name
        elif not field.is_repeated:
            yield from _columns(field.message_type, f"{prefix}{field.name}.")
