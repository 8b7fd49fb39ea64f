"""A recording that librealsense writes of known images, and what is left out where it cannot be had."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from camera_process import SHOTS, colour_of, depth_of
from lenses import rig
from librealsense_here import left_out, reason

collect_ignore = left_out(["test_lens.py", "test_live.py", "test_process.py"])


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Says so, however quiet pytest is."""
    if collect_ignore:
        terminalreporter.write_line(f"air/sensors: {reason(collect_ignore)}")


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of it, 30 a second."""
    from software_camera import Shot, SoftwareCamera  # it needs librealsense

    begun_ms = time.time() * 1000.0
    shots = (
        Shot(colour_HW3=colour_of(k), depth_HW=depth_of(), wall_ms=begun_ms + k * 1000.0 / 30) for k in range(SHOTS)
    )
    return SoftwareCamera(rig()).record(tmp_path_factory.mktemp("recording") / "known.db3", shots)
