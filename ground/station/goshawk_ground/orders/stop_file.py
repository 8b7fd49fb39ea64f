"""A Stop that is not confirmed yet, on disk: one small file a vehicle, so that a new ground goes on asking."""

from __future__ import annotations

import json
import math
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class PendingStop:
    """What is needed to go on asking."""

    command_id: str
    pressed_unix_s: float
    """Wall time: it must mean the same after a restart of the machine."""


def state_folder() -> Path:
    """Where a user's programs keep what must outlive them."""
    base = os.environ.get("XDG_STATE_HOME") or "~/.local/state"
    return Path(base).expanduser() / "goshawk"


class StopFile:
    """The file of one vehicle. It is whole or absent, whenever the machine stops."""

    def __init__(self, folder: Path, vehicle: str) -> None:
        self.path = folder / f"stop-{vehicle}.json"

    def load(self) -> PendingStop | None:
        """The Stop that was pending; None: there is none, or the file holds something else."""
        try:
            facts = json.loads(self.path.read_text(encoding="utf-8"))
            stop = PendingStop(command_id=str(facts["command_id"]), pressed_unix_s=float(facts["pressed_unix_s"]))
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return stop if 1 <= len(stop.command_id) <= 64 and math.isfinite(stop.pressed_unix_s) else None

    def save(self, stop: PendingStop) -> None:
        """Keeps a Stop in place of any other. Raises OSError."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        descriptor, name = tempfile.mkstemp(dir=self.path.parent, prefix=self.path.name)
        try:
            with os.fdopen(descriptor, "w", encoding="utf-8") as file:
                json.dump({"command_id": stop.command_id, "pressed_unix_s": stop.pressed_unix_s}, file)
                file.flush()
                os.fsync(file.fileno())
            Path(name).replace(self.path)
        except OSError:
            Path(name).unlink(missing_ok=True)
            raise
        self._sync_folder()

    def forget(self, command_id: str) -> None:
        """Removes this Stop; another one that has taken its place stays. Raises OSError."""
        kept = self.load()
        if kept is not None and kept.command_id != command_id:
            return
        self.path.unlink(missing_ok=True)

    def _sync_folder(self) -> None:
        """Else the new name may be lost with the machine's power."""
        folder = os.open(self.path.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
