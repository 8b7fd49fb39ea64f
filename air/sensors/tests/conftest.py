"""A recording that librealsense writes of known images."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from camera_process import SHOTS, colour_of, depth_of
from software_camera import Shot, SoftwareCamera, rig


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of it, 30 a second."""
    begun_ms = time.time() * 1000.0
    shots = (
        Shot(colour_HW3=colour_of(k), depth_HW=depth_of(), wall_ms=begun_ms + k * 1000.0 / 30) for k in range(SHOTS)
    )
    return SoftwareCamera(rig()).record(tmp_path_factory.mktemp("recording") / "known.db3", shots)
