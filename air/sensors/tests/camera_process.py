"""The real `goshawk-camera` process, and the images that it is given."""

from __future__ import annotations

import resource
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
PLUGGED = (sys.executable, str(Path(__file__).with_name("software_process.py")))
"""The same, where a camera is plugged in."""


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


def camera(*arguments: str | Path, command: tuple[str, ...] = COMMAND) -> subprocess.CompletedProcess[str]:
    """`goshawk-camera` to its end."""
    return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, timeout=120)


@contextmanager
def running(
    *arguments: str | Path, command: tuple[str, ...] = COMMAND, disk_bytes: int | None = None
) -> Generator[subprocess.Popen[str]]:
    """`goshawk-camera` in the background; it is ended with the block. ``disk_bytes``: no file gets larger."""

    def small_disk() -> None:
        if disk_bytes is not None:  # Python ignores SIGXFSZ: the write fails, as on a full disk
            resource.setrlimit(resource.RLIMIT_FSIZE, (disk_bytes, resource.RLIM_INFINITY))

    process = subprocess.Popen(
        [*command, *map(str, arguments)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=small_disk,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.kill()
        process.communicate()
