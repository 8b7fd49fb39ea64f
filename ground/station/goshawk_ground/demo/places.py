"""Where the vehicle's and the simulator's programs and files are: in a checkout, or where their packages put them."""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

BUILT = Path("target/release")
"""What `make build` fills, from a checkout's root."""
CHECKOUT = Path("air/vehicles")
PACKAGED = Path("/usr/share/goshawk/vehicles")
"""Vehicle files as the package goshawk-air brings them, policies beside that folder in `models`."""


def in_checkout() -> bool:
    """Whether the current directory is a checkout's root."""
    return CHECKOUT.is_dir()


def programs() -> Path:
    """The folder of goshawk-air and goshawk-sim: a checkout's, else the one that the PATH names."""
    installed = None if in_checkout() else shutil.which("goshawk-air")
    return BUILT if installed is None else Path(installed).parent


def vehicle_file(name: str) -> Path:
    """A shipped vehicle file."""
    return (CHECKOUT if in_checkout() else PACKAGED) / name


def goal_of(vehicle: Path) -> tuple[float, float]:
    """How far ahead the goal of a vehicle file's default profile lies, m, and how fast it is flown to, m/s. Raises
    OSError where the file cannot be read."""
    told = tomllib.loads(vehicle.read_text(encoding="utf-8"))
    profile = next(row for row in told["profile"] if row["name"] == told["default_profile"])
    return profile["goal_m"][0], profile["speed_mps"]


def policies() -> list[Path]:
    """The shipped policies."""
    return sorted(((CHECKOUT if in_checkout() else PACKAGED).parent / "models").glob("*.onnx"))
