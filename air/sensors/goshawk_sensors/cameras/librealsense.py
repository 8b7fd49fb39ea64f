"""librealsense's Python package, which comes without types: what it gives is given one where it is used.

Raises CameraError where it is not installed: an OAK-D, `--help` and the profiles need none of it.
"""

from __future__ import annotations

import importlib
from typing import Any

from goshawk_sensors.setup.errors import CameraError

try:
    rs: Any = importlib.import_module("pyrealsense2")
except ImportError as error:
    raise CameraError(
        f"librealsense is not here ({error}): on x86-64 install it with make setup-camera, on arm64 build it as "
        "docs/how-to/camera.md says"
    ) from error

Handle = Any
"""An object of librealsense: a device, a sensor, a profile, a frame, a key of an enumeration."""
