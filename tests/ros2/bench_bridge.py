"""How much of a core the bridge takes: `python tests/ros2/bench_bridge.py`.

Colour and depth of 640 x 480 come at 30 Hz and odometry at 100 Hz. The yardstick is 15 % of a core.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT / "tests/e2e"), str(ROOT / "tests/ros2")]
from bridge_rig import TOPICS, BridgeRig, VehicleEnd  # noqa: E402
from pictures import camera_info, image, odometry  # noqa: E402

SIZE_PX = (480, 640)
IMAGES_HZ, MOTIONS_HZ, SECONDS = 30, 100, 10
YARDSTICK = 0.15


def cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    rng = np.random.default_rng(1)
    rgb, depth = rng.integers(0, 255, (*SIZE_PX, 3), np.uint8), rng.integers(500, 9000, SIZE_PX).astype("<u2")
    camera, motion = TOPICS["camera"], TOPICS["odometry"]["topic"]
    with tempfile.TemporaryDirectory() as folder:
        bridge = BridgeRig(Path(folder))
        vehicle = VehicleEnd(bridge.rig.zenoh_port)
        bridge.start()
        pid = bridge.rig.processes["bridge"].pid
        height, width = SIZE_PX
        k = np.array([320.0, 0, (width - 1) / 2, 0, 320.0, (height - 1) / 2, 0, 0, 1.0])
        used = begun = 0.0
        for tick in range(MOTIONS_HZ * (SECONDS + 2)):
            if tick == 2 * MOTIONS_HZ:  # the network stands
                used, begun = cpu_s(pid), time.monotonic()
                vehicle.images.clear()
            now = time.time_ns()
            bridge.ros.publish(
                motion, "nav_msgs/msg/Odometry", odometry(now, (0, 0, 0), (0, 0, 0, 1), (0, 0, 0), (0, 0, 0))
            )
            if tick * IMAGES_HZ // MOTIONS_HZ != (tick - 1) * IMAGES_HZ // MOTIONS_HZ:
                info = camera_info(now, height=height, width=width, k=k)
                bridge.ros.publish(camera["info"], "sensor_msgs/msg/CameraInfo", info)
                bridge.ros.publish(camera["colour"], "sensor_msgs/msg/Image", image(now, "rgb8", rgb))
                bridge.ros.publish(camera["depth"], "sensor_msgs/msg/Image", image(now, "16UC1", depth))
            due = (begun or time.monotonic()) + (tick - 2 * MOTIONS_HZ) / MOTIONS_HZ
            time.sleep(1 / MOTIONS_HZ if not begun else max(0.0, due - time.monotonic()))
        seconds = time.monotonic() - begun
        share, images = (cpu_s(pid) - used) / seconds, len(vehicle.images) / seconds
        bridge.close()
        vehicle.close()
    print(f"bridge: {100 * share:.1f} % of a core, {images:.1f} images/s; wanted: {100 * YARDSTICK:.0f} % at most")


if __name__ == "__main__":
    main()
