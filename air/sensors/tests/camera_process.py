"""The real `goshawk-camera` process, and the images that it is given."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from goshawk_sensors.view.resample import Colour, Millimetres

ROOT = Path(__file__).resolve().parents[3]
VEHICLE = ROOT / "air/vehicles/sim.toml"
X500 = ROOT / "air/vehicles/x500.toml"
SHOTS = 30
COMMAND = (sys.executable, "-c", "from goshawk_sensors.cli import main; main()")


def colour_of(k: int) -> Colour:
    """The k-th image of the recording: 320 x 192, four quarters of one colour each, and a count in the first."""
    image = np.zeros((192, 320, 3), dtype=np.uint8)
    image[:96, :160], image[:96, 160:] = (k, 10, 20), (200, 0, 0)
    image[96:, :160], image[96:, 160:] = (0, 200, 0), (0, 0, 200)
    return image


def depth_of() -> Millimetres:
    """A wall at 6 m, with a post at 2 m whose left and right edges lie within our pixels, and a hole."""
    image = np.full((192, 320), 6000, dtype=np.uint16)
    image[:, 101:106] = 2000
    image[20:60, 200:280] = 0
    return image


def camera(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """`goshawk-camera` to its end."""
    return subprocess.run([*COMMAND, *map(str, arguments)], capture_output=True, text=True, timeout=120)


@contextmanager
def running(*arguments: str | Path) -> Generator[subprocess.Popen[str]]:
    """`goshawk-camera` in the background; it is ended with the block."""
    process = subprocess.Popen(
        [*COMMAND, *map(str, arguments)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()
