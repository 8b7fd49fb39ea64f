"""Fixtures of the tests over real processes, and what is left out where librealsense cannot be had."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from librealsense_here import left_out, reason
from rig import Rig

collect_ignore = left_out(["test_camera.py"])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Says so, however quiet pytest is."""
    if collect_ignore:
        terminalreporter.write_line(f"tests/e2e: {reason(collect_ignore)}")


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    """Ports and a folder; whatever was started in it ends with the test."""
    rig = Rig(folder=tmp_path)
    yield rig
    rig.close()
