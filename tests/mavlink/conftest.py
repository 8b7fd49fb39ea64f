"""Builds the example programs that these tests talk to."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def example() -> Callable[[str], Path]:
    """The path of an example program of the workspace, built."""

    def build(name: str) -> Path:
        command = ["cargo", "build", "--release", "--locked", "-q", "--workspace", "--example", name]
        subprocess.run(command, cwd=ROOT, check=True)
        return ROOT / "target/release/examples" / name

    return build


@pytest.fixture(scope="session")
def air() -> Path:
    """The path of the onboard program, built."""
    subprocess.run(["cargo", "build", "--release", "--locked", "-q", "--bins"], cwd=ROOT, check=True)
    return ROOT / "target/release/goshawk-air"
