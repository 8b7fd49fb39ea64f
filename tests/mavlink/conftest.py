"""Builds the example programs that these tests talk to."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def example() -> Callable[[str, str], Path]:
    """The path of a crate's example program, built."""

    def build(crate: str, name: str) -> Path:
        command = ["cargo", "build", "--release", "--locked", "-q", "-p", crate, "--example", name]
        subprocess.run(command, cwd=ROOT, check=True)
        return ROOT / "target/release/examples" / name

    return build
