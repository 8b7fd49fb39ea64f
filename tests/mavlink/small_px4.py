"""A whole small PX4, run as `bin/px4`: its motors over the simulator interface, its offboard mode over MAVLink. It
takes the truth for its estimate. Made with pymavlink; it shares nothing with the project."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from typing import Any

import numpy as np
from firmware import Motion, Px4
from pymavlink.dialects.v20 import common as mavlink

OFFBOARD, HOLD = 0x00060000, 0x03040000
ARM, SET_MODE = 400, 176
PREARM = 1 << 28


class Offboard:
    """The companion's line: what it is told, what it asks."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.connect(("127.0.0.1", port))
        self.socket.setblocking(False)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.parser = mavlink.MAVLink(None)
        self.armed, self.mode = False, HOLD
        self.wish: tuple[np.ndarray, float] | None = None

    def send(self, message: Any) -> None:
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            self.socket.send(message.pack(self.mav))

    def receive(self, now_us: int) -> None:
        """Takes all that has come."""
        while True:
            try:
                data = self.socket.recv(2048)
            except (BlockingIOError, ConnectionRefusedError):
                return
            messages: list[Any] = self.parser.parse_buffer(data) or []
            for message in messages:
                self.take(message, now_us)

    def take(self, message: Any, now_us: int) -> None:
        kind = message.get_type()
        if kind == "SET_ATTITUDE_TARGET":
            self.wish = (np.array(message.q), message.thrust)
        elif kind == "TIMESYNC" and message.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(now_us * 1000, message.ts1))
        elif kind == "COMMAND_LONG":
            if message.command == ARM:
                self.armed = message.param1 == 1
            elif message.command == SET_MODE:
                self.mode = OFFBOARD if message.param2 == 6 else HOLD
            self.send(mavlink.MAVLink_command_ack_message(message.command, 0))

    def report(self, tick: int, now_us: int, motion: Motion, place: np.ndarray, *, landed: bool) -> None:
        """What is due at `tick`, of 4 ms."""
        if tick % 3 == 0:
            self.send(
                mavlink.MAVLink_odometry_message(
                    now_us, 1, 1, place[0], place[1], place[2], list(motion.quaternion),
                    motion.vel_ned[0], motion.vel_ned[1], motion.vel_ned[2],
                    motion.rates[0], motion.rates[1], motion.rates[2], [0.01] * 21, [0.01] * 21, 0, 8, 100,
                )
            )  # fmt: skip
        if tick % 25 == 0:
            base = 1 | (128 if self.armed else 0)
            self.send(mavlink.MAVLink_heartbeat_message(2, 12, base, self.mode, 4, 3))
            self.send(mavlink.MAVLink_extended_sys_state_message(0, 1 if landed else 2))
            self.send(mavlink.MAVLink_sys_status_message(PREARM, PREARM, PREARM, 100, 15000, 100, 90, 0, 0, 0, 0, 0, 0))


def motors(motion: Motion, wish: tuple[np.ndarray, float]) -> list[float]:
    """An attitude loop, a rate loop and a mixer."""
    (w, *axis), thrust = wish
    q = motion.quaternion * np.array([1, -1, -1, -1])
    error_w = q[0] * w - q[1:] @ axis
    error = q[0] * np.array(axis) + w * q[1:] + np.cross(q[1:], axis)
    rates = np.array([12, 12, 4]) * 2 * np.sign(error_w) * error
    r, p, y = np.array([0.012, 0.012, 0.02]) * (rates - motion.rates)
    mixed = (thrust - r + p + y, thrust + r - p + y, thrust + r + p - y, thrust - r - p - y)
    return [max(0.02, min(1.0, float(u))) for u in mixed]


def main() -> None:
    """`-i N` as the real one; dials TCP 4560 and speaks to UDP 14540 until the simulator hangs up.

    With `DIES_ABOVE_M` in the environment it ends in the air.
    """
    highest_m = float(os.environ.get("DIES_ABOVE_M", "inf"))
    instance = int(sys.argv[sys.argv.index("-i") + 1]) if "-i" in sys.argv else 0
    px4, line = Px4(4560 + instance), Offboard(14540 + instance)
    origin: np.ndarray | None = None
    tick, still = 0, 0
    with contextlib.suppress(ConnectionResetError, BrokenPipeError):
        while True:
            found = px4.sample()
            now_us = found["HIL_SENSOR"].time_usec
            line.receive(now_us)
            throttles = None
            if "HIL_STATE_QUATERNION" in found:
                motion = px4.motion(found)
                place = np.array([*px4.place(found), motion.down_m])
                origin = place if origin is None else origin
                still = still + 1 if np.linalg.norm(motion.vel_ned) < 0.1 else 0
                if origin[2] - place[2] > highest_m:
                    sys.exit("hard fault in the mixer")
                line.report(tick, now_us, motion, place - origin, landed=still > 250)
                if line.armed:
                    throttles = [0.02] * 4 if line.wish is None else motors(motion, line.wish)
            px4.control(now_us, throttles)
            tick += 1


if __name__ == "__main__":
    main()
