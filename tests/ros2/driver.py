"""What a ROS 2 camera driver and a visual-inertial estimator would publish, of the simulator's world.

The simulator dials this instead of the vehicle: its images become `sensor_msgs/Image`. Its MAVLink passes through here,
and ODOMETRY becomes `nav_msgs/Odometry`. It is a process of its own: what a test does meanwhile
must not hold up odometry.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import signal
import socket
import threading
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from goshawk_proto import key_expression
from pictures import camera_info, image, odometry
from pymavlink.dialects.v20 import common as mavlink
from ros_peer import RosPeer, listening
from scipy.spatial.transform import Rotation

PART = 2
"""A driver in Python sends no more than 320 x 192 beside other tests: so much less of the pictures' camera each way."""
FINER = 4 // PART
"""The simulator's 160 x 96 as that camera has it."""
ENU_FROM_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD_FROM_FLU = np.diag([1.0, -1.0, -1.0])


def odometry_reader() -> Callable[[bytes], list[Any]]:
    """The messages ODOMETRY in a stream's next bytes."""
    reader: Any = mavlink.MAVLink(None)
    reader.robust_parsing = True

    def read(data: bytes) -> list[Any]:
        messages: list[Any] = reader.parse_buffer(data) or []
        return [message for message in messages if message.get_type() == "ODOMETRY"]

    return read


class Driver:
    """Both, for one simulator. Close it when done."""

    def __init__(self, ros: RosPeer, topics: dict[str, Any], vehicle: str, port: int, mavlink: tuple[int, int]) -> None:
        """It listens for images on `port`; MAVLink comes to the first port and goes on to the second."""
        self.ros, self.topics = ros, topics
        self._session = listening(port, "peer")
        self._session.declare_subscriber(key_expression("rgbd", vehicle), lambda s: self._image(s.payload.to_bytes()))
        self._closing = threading.Event()
        self._from_sim, self._to_vehicle = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._from_sim.bind(("127.0.0.1", mavlink[0]))
        self._to_vehicle.connect(("127.0.0.1", mavlink[1]))
        self._sim: Any = None
        self.estimates: list[Any] = []
        """ODOMETRY of the simulated autopilot."""
        self.sent_on: list[Any] = []
        """ODOMETRY of the vehicle to it."""
        self._threads = [threading.Thread(target=work, daemon=True) for work in (self._there, self._back)]
        for end in (self._from_sim, self._to_vehicle):
            end.settimeout(0.1)
        for thread in self._threads:
            thread.start()

    def _image(self, payload: bytes) -> None:
        sent = pb.Rgbd.FromString(payload)
        stamp_ns = sent.stamp_ns + time.time_ns() - time.monotonic_ns()
        rgb = np.frombuffer(sent.rgb, np.uint8).reshape(sent.height, sent.width, 3)
        depth = np.frombuffer(sent.depth_mm, "<u2").reshape(sent.height, sent.width)
        camera = self.topics["camera"]
        fine = [np.repeat(np.repeat(pixels, FINER, axis=0), FINER, axis=1) for pixels in (rgb, depth)]
        self.ros.publish(camera["info"], "sensor_msgs/msg/CameraInfo", camera_info(stamp_ns, part=PART))
        for topic, encoding, pixels in [(camera["colour"], "rgb8", fine[0]), (camera["depth"], "16UC1", fine[1])]:
            self.ros.publish(topic, "sensor_msgs/msg/Image", image(stamp_ns, encoding, pixels))

    def _there(self) -> None:
        read = odometry_reader()
        while not self._closing.is_set():
            with contextlib.suppress(TimeoutError, ConnectionError):
                data, self._sim = self._from_sim.recvfrom(2048)
                self._to_vehicle.send(data)
                for message in read(data):
                    self.estimates.append(message)
                    self._motion(message)

    def _back(self) -> None:
        read = odometry_reader()
        while not self._closing.is_set():
            with contextlib.suppress(TimeoutError, ConnectionError):
                data = self._to_vehicle.recv(2048)
                self.sent_on += read(data)
                if self._sim is not None:
                    self._from_sim.sendto(data, self._sim)

    def _motion(self, m: Any) -> None:
        """The stand-in's estimate, its velocity north, east, down, as REP 103 and 105 have it."""
        w, x, y, z = m.q
        enu_from_flu = ENU_FROM_NED @ Rotation.from_quat([x, y, z, w]).as_matrix() @ FRD_FROM_FLU
        pos = ENU_FROM_NED @ [m.x, m.y, m.z]
        vel = enu_from_flu.T @ ENU_FROM_NED @ [m.vx, m.vy, m.vz]
        rate = FRD_FROM_FLU @ [m.rollspeed, m.pitchspeed, m.yawspeed]
        quaternion = Rotation.from_matrix(enu_from_flu).as_quat()
        message = odometry(time.time_ns(), pos.tolist(), quaternion.tolist(), vel.tolist(), rate.tolist())
        self.ros.publish(self.topics["odometry"]["topic"], "nav_msgs/msg/Odometry", message)

    def close(self) -> None:
        self._closing.set()
        for thread in self._threads:
            thread.join()
        for end in (self._from_sim, self._to_vehicle):
            end.close()
        self._session.close()  # pyright: ignore[reportUnknownMemberType]


def main() -> None:
    """Until SIGTERM; then both lists of ODOMETRY are in a file."""
    parser = argparse.ArgumentParser()
    for name, kind in [("router", str), ("topics", Path), ("vehicle", str), ("port", int), ("heard", Path)]:
        parser.add_argument(f"--{name}", type=kind, required=True)
    parser.add_argument("--mavlink", type=int, nargs=2, required=True)
    given = parser.parse_args()
    # Before any thread begins, so that none of them takes it.
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
    ros = RosPeer(given.router)
    topics = tomllib.loads(given.topics.read_text())
    driver = Driver(ros, topics, given.vehicle, given.port, (given.mavlink[0], given.mavlink[1]))
    print("ready", flush=True)
    signal.sigwait({signal.SIGTERM})
    driver.close()
    ros.close()
    heard = {
        "estimates": [message.to_dict() for message in driver.estimates],
        "sent_on": [message.to_dict() | {"component": message.get_srcComponent()} for message in driver.sent_on],
    }
    given.heard.write_text(json.dumps(heard))


if __name__ == "__main__":
    main()
