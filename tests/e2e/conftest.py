"""Fixtures of the tests over real processes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from rig import Rig


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """Ports and a folder; whatever was started in it ends with the test."""
    rig = Rig(folder=tmp_path)
    yield rig
    rig.close()
