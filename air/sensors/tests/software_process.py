"""`goshawk-camera` with a camera of librealsense's software plugged in, which delivers noise: it fills a disk soon."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from goshawk_sensors.cameras import realsense
from goshawk_sensors.cli import main
from lenses import rig
from software_camera import Shot, SoftwareCamera


def film(camera: SoftwareCamera, ending: threading.Event) -> None:
    random = np.random.default_rng(1)
    colour = random.integers(0, 255, (192, 320, 3), dtype=np.uint8)
    depth = random.integers(300, 6000, (192, 320), dtype=np.uint16)
    while not ending.wait(1 / 30):
        camera.shoot(Shot(colour_HW3=colour, depth_HW=depth, wall_ms=time.time() * 1000.0))


if __name__ == "__main__":
    plugged, ending = SoftwareCamera(rig()), threading.Event()

    def cameras(_: Any = None) -> list[Any]:
        return [plugged.device]

    realsense.cameras = cameras
    filming = threading.Thread(target=film, args=(plugged, ending))
    filming.start()
    try:
        main()
    finally:
        ending.set()
        filming.join()
