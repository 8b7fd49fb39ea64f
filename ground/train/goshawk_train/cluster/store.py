"""Where a campaign is kept: a local folder, or any address that fsspec knows, such as s3://bucket/campaign.

plan.json             what is flown, and with what
processor.json        what it is flown on
units/NAME.parquet    what is finished: a row a flight, its whole record too
flights.parquet       all flights, a row each, without the records
cells/ROW.json        the cells of each row, as `goshawk-sim fly --json` writes them
logs/                 the flights that were flown again
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, cast

import fsspec

from goshawk_train.errors import TrainerError


class StoreError(TrainerError):
    """The place cannot be used; the message says why."""


class Store:
    """One campaign's files, by their names in it."""

    def __init__(self, address: str) -> None:
        self.address = address.rstrip("/")
        try:
            # What others wrote since must be seen: nothing of a listing is kept.
            known: Any = fsspec.core
            self.fs, root = known.url_to_fs(self.address, use_listings_cache=False)
        except (ImportError, ValueError) as error:
            raise StoreError(f"{address}: {error}") from error
        self.root = str(root).rstrip("/")
        self.local = "file" in (self.fs.protocol if isinstance(self.fs.protocol, tuple) else (self.fs.protocol,))

    def path(self, name: str) -> str:
        """For the file system."""
        return f"{self.root}/{name}"

    def url(self, name: str) -> str:
        """For people and other programs."""
        return f"{self.address}/{name}"

    def names(self, folder: str) -> set[str]:
        """The files right in a folder; none if there is no such folder."""
        try:
            return {str(path).rsplit("/", 1)[-1] for path in self.fs.ls(self.path(folder), detail=False)}
        except FileNotFoundError:
            return set()

    def write(self, name: str, content: bytes) -> None:
        """A whole file, or none: a reader never sees a part."""
        path = self.path(name)
        try:
            if not self.local:
                self.fs.pipe_file(path, content)
                return
            self.fs.makedirs(path.rsplit("/", 1)[0], exist_ok=True)
            partial = f"{path}.{os.getpid()}.part"
            self.fs.pipe_file(partial, content)
            Path(partial).replace(path)
        except OSError as error:
            raise StoreError(f"cannot write {self.url(name)}: {error}") from error

    def read(self, name: str) -> bytes:
        """Raises `StoreError`."""
        try:
            return self.fs.cat_file(self.path(name))
        except OSError as error:
            raise StoreError(f"cannot read {self.url(name)}: {error}") from error

    def has(self, name: str) -> bool:
        """Whether there is such a file."""
        return bool(self.fs.exists(self.path(name)))

    def read_json(self, name: str) -> dict[str, Any]:
        """Raises `StoreError`."""
        try:
            value = json.loads(self.read(name))
        except ValueError as error:
            raise StoreError(f"{self.url(name)} is damaged: {error}") from error
        if not isinstance(value, dict):
            raise StoreError(f"{self.url(name)} is no file of a campaign")
        return cast("dict[str, Any]", value)

    def write_json(self, name: str, value: dict[str, Any]) -> None:
        """For people to read too."""
        self.write(name, f"{json.dumps(value, indent=1)}\n".encode())
