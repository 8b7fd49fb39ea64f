"""Two small firmwares that speak the simulator interfaces of PX4 and ArduPilot by pymavlink, struct and json: made from
those projects' documents, and from nothing of ours. Frames are theirs: north-east-down, forward-right-down."""

from __future__ import annotations

import contextlib
import json
import math
import socket
import struct
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

HOME = (47.397742, 8.545594, 488.0)
EARTH_M = 6_371_000.0
ARMED = 128 | 1


@dataclass(kw_only=True)
class Motion:
    """What a firmware knows of its vehicle."""

    down_m: float
    vel_ned: np.ndarray
    quaternion: np.ndarray
    """(w, x, y, z), NED from FRD."""
    rates: np.ndarray

    def in_ned(self, frd: np.ndarray) -> np.ndarray:
        """A vector of the body in the world's frame."""
        w, axis = self.quaternion[0], self.quaternion[1:]
        return frd + 2 * np.cross(axis, np.cross(axis, frd) + w * frd)

    @property
    def euler(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw."""
        w, x, y, z = self.quaternion
        roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x))))
        return roll, pitch, math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


@dataclass(kw_only=True)
class Wish:
    """Where to hover, and how the body is to lie meanwhile."""

    height_m: float
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float


def motors(motion: Motion, wish: Wish) -> list[float]:
    """Four motors of a quadrotor X in the order and sense of both projects: front right and rear left turn
    counterclockwise, front left and rear right clockwise."""
    roll, pitch, yaw = motion.euler
    turn = (wish.yaw - yaw + math.pi) % (2 * math.pi) - math.pi
    wanted = np.array([4 * (wish.roll - roll), 4 * (wish.pitch - pitch), 2 * max(-1.0, min(1.0, turn))])
    r, p, y = np.array([0.008, 0.008, 0.02]) * (wanted - motion.rates)
    thrust = 0.35 + 0.05 * (wish.height_m + motion.down_m) + 0.07 * motion.vel_ned[2]
    mixed = (thrust - r + p + y, thrust + r - p + y, thrust + r + p - y, thrust - r - p - y)
    return [max(0.0, min(1.0, float(u))) for u in mixed]


class Px4:
    """A PX4 in SITL as far as its simulator sees it."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.parser = mavlink.MAVLink(None)
        self.waiting: list[Any] = []
        self.send(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3))
        self.send(mavlink.MAVLink_command_long_message(0, 0, 511, 0, 115, 4000, 0, 0, 0, 0, 0))

    def send(self, message: Any) -> None:
        self.socket.sendall(message.pack(self.mav))

    def receive(self) -> Any:
        """The next message."""
        while not self.waiting:
            data = self.socket.recv(4096)
            if not data:
                raise ConnectionResetError
            self.waiting = self.parser.parse_buffer(data) or []
        return self.waiting.pop(0)

    def sample(self) -> dict[str, Any]:
        """All up to the next HIL_SENSOR, by name."""
        found: dict[str, Any] = {}
        while "HIL_SENSOR" not in found:
            message = self.receive()
            found[message.get_type()] = message
        return found

    def control(self, stamp_us: int, throttles: list[float] | None) -> None:
        """The motors' commands; none: disarmed."""
        controls = [0.0] * 16 if throttles is None else [*throttles, *[0.0] * 12]
        mode = 1 if throttles is None else ARMED
        self.send(mavlink.MAVLink_hil_actuator_controls_message(stamp_us, controls, mode, 1))

    @staticmethod
    def motion(found: dict[str, Any]) -> Motion:
        """The truth that it asked for, with the gyroscope's rates."""
        state, sensor = found["HIL_STATE_QUATERNION"], found["HIL_SENSOR"]
        return Motion(
            down_m=HOME[2] - state.alt * 1e-3,
            vel_ned=np.array([state.vx, state.vy, state.vz]) * 1e-2,
            quaternion=np.array(state.attitude_quaternion),
            rates=np.array([sensor.xgyro, sensor.ygyro, sensor.zgyro]),
        )

    @staticmethod
    def place(found: dict[str, Any]) -> np.ndarray:
        """North and east of home, m."""
        state = found["HIL_STATE_QUATERNION"]
        north = math.radians(state.lat * 1e-7 - HOME[0]) * EARTH_M
        east = math.radians(state.lon * 1e-7 - HOME[1]) * EARTH_M * math.cos(math.radians(HOME[0]))
        return np.array([north, east])


class ArduPilot:
    """An ArduPilot in SITL with `--model JSON`, as far as its physics sees it."""

    def __init__(self, port: int, rate_hz: int = 500) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(10)
        self.rate_hz = rate_hz
        self.frame = 0

    def step(self, throttles: list[float], *, again: bool = False) -> dict[str, Any]:
        """Sends the servos, and gives the motion after them. `again`: the same packet once more."""
        self.frame += 0 if again else 1
        pulses = [1000 + round(1000 * u) for u in throttles] + [0] * 12
        self.socket.send(struct.pack("<HHI16H", 18458, self.rate_hz, self.frame, *pulses))
        line = self.socket.recv(4096)
        assert line.startswith(b"\n") and line.endswith(b"\n")
        return json.loads(line)

    @staticmethod
    def motion(answer: dict[str, Any]) -> Motion:
        """As the physics tells it."""
        return Motion(
            down_m=answer["position"][2],
            vel_ned=np.array(answer["velocity"]),
            quaternion=np.array(answer["quaternion"]),
            rates=np.array(answer["imu"]["gyro"]),
        )


class SelfSimulated:
    """A PX4 that simulates its own vehicle: it stands facing north for a second, then goes north at 1 m/s."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.settimeout(0.005)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.begun = time.monotonic()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def close(self) -> None:
        self.ended.set()
        self.thread.join()

    def now(self) -> float:
        """Since it began, s."""
        return time.monotonic() - self.begun

    def _send(self, message: Any) -> None:
        with contextlib.suppress(ConnectionRefusedError):  # nobody listens yet
            self.socket.send(message.pack(self.mav))

    def _run(self) -> None:
        parser = mavlink.MAVLink(None)
        ticks = 0
        while not self.ended.is_set():
            self._answer(parser)
            now = self.now()
            if now * 50 < ticks:
                continue
            if ticks % 50 == 0:
                self._send(mavlink.MAVLink_heartbeat_message(2, 12, 0x81, 0, 3, 3))
            north, speed = (now - 1.0, 1.0) if now > 1.0 else (0.0, 0.0)
            self._send(
                mavlink.MAVLink_odometry_message(
                    int(now * 1e6), 1, 1, north, 0.0, -1.0, [1.0, 0.0, 0.0, 0.0], speed, 0.0, 0.0, 0.0, 0.0, 0.0,
                    [0.01] * 21, [0.01] * 21, 0, 8, 100,
                )
            )  # fmt: skip
            ticks += 1

    def _answer(self, parser: Any) -> None:
        """Its clock, to whoever asks."""
        try:
            messages: list[Any] = parser.parse_buffer(self.socket.recv(2048)) or []
        except (TimeoutError, ConnectionRefusedError):
            return
        for message in messages:
            if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                self._send(mavlink.MAVLink_timesync_message(int(self.now() * 1e9), message.ts1))
