"""Builds the programs that these tests talk to."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def built() -> Path:
    """The folder with all programs and examples, built as `make test` builds them."""
    command = ["cargo", "build", "--release", "--locked", "-q", "--workspace", "--bins", "--examples"]
    subprocess.run(command, cwd=ROOT, check=True)
    return ROOT / "target/release"


@pytest.fixture(scope="session")
def example(built: Path) -> Callable[[str], Path]:
    """The path of an example program."""
    return lambda name: built / "examples" / name


@pytest.fixture(scope="session")
def air(built: Path) -> Path:
    """The path of the onboard program."""
    return built / "goshawk-air"
