"""The example program `wire`: our link, told what to do by lines."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any


class Wire:
    """One running link. `port` is where it listens, if it does."""

    def __init__(self, program: Path, *arguments: str | Path) -> None:
        command = [str(part) for part in (program, *arguments)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.port: int | None = self._answer()["listening"]

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def tell(self, line: str) -> dict[str, Any]:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self._answer()

    def read(self) -> dict[str, Any]:
        return self.tell("read")

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        assert self.process.wait(timeout=5) == 0
