"""librealsense's Python package, which comes without types: what it gives is given one where it is used."""

from __future__ import annotations

import importlib
from typing import Any

rs: Any = importlib.import_module("pyrealsense2")

Handle = Any
"""An object of librealsense: a device, a sensor, a profile, a frame, a key of an enumeration."""
