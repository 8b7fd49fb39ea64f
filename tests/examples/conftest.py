"""Real processes for the examples, as for tests/e2e."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "e2e"))

from rig import BIN, ROOT, Rig


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """Ports and a folder; whatever was started in it ends with the test."""
    rig = Rig(folder=tmp_path)
    yield rig
    rig.close()


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of one flight in lockstep."""
    folder = tmp_path_factory.mktemp("flight")
    command = [BIN / "goshawk-sim", "fly", "--task", "track", "--speed", "3", "--trials", "1", "--log", folder]
    done = subprocess.run([str(c) for c in command], cwd=ROOT, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stdout + done.stderr
    (log,) = folder.rglob("*.mcap")
    return log
