"""Which tests are left out where librealsense cannot be had: the package index has it for x86-64 alone."""

from __future__ import annotations

import importlib.util
import platform
from collections.abc import Sequence


def left_out(files: Sequence[str]) -> list[str]:
    """These files, or none. On x86-64 it is pinned, so there a test that lacks it fails."""
    here = platform.machine() == "x86_64" or importlib.util.find_spec("pyrealsense2") is not None
    return [] if here else list(files)


def reason(files: Sequence[str]) -> str:
    """One line."""
    return f"left out, for there is no librealsense (docs/how-to/camera.md, On arm64): {', '.join(files)}"
