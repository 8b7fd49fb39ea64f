"""An ArduPilot Copter's end of a MAVLink link, made of pymavlink: its parameters, modes, arming and streams."""

from __future__ import annotations

import math
import os
import select
import socket
import time
import tty
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

STABILIZE, GUIDED, LOITER, LAND, GUIDED_NOGPS = 0, 4, 5, 9, 20
STREAMS = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
}
EKF_PREDICTED = mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_PRED_POS_HORIZ_ABS
"""It has just started, and GPS is there."""
EKF_HAS = EKF_PREDICTED | mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS


class Port(Protocol):
    """One end of a line."""

    address: str

    def read(self) -> bytes:
        """What has come, after at most a few ms."""
        ...

    def write(self, data: bytes) -> None: ...

    def close(self) -> None: ...


class Tcp:
    """Listens as ArduPilot's simulation does; `cut` ends a connection as a pulled plug does."""

    def __init__(self) -> None:
        self.server = socket.create_server(("127.0.0.1", 0))
        self.server.settimeout(5.0)
        self.address = f"tcpout:127.0.0.1:{self.server.getsockname()[1]}"
        self.stream: socket.socket | None = None

    def accepted(self) -> socket.socket:
        if self.stream is None:
            self.stream, _ = self.server.accept()
            self.stream.settimeout(0.005)
        return self.stream

    def read(self) -> bytes:
        try:
            return self.accepted().recv(4096)
        except TimeoutError:
            return b""

    def write(self, data: bytes) -> None:
        self.accepted().sendall(data)

    def cut(self) -> None:
        if self.stream is not None:
            self.stream.close()
        self.stream = None

    def close(self) -> None:
        self.cut()
        self.server.close()


class Serial:
    """A pseudo-terminal: a serial cable without a port at either end."""

    def __init__(self) -> None:
        self.ours, self.theirs = os.openpty()
        tty.setraw(self.theirs)
        self.address = f"serial:{os.ttyname(self.theirs)}:921600"

    def read(self) -> bytes:
        ready, _, _ = select.select([self.ours], [], [], 0.005)
        return os.read(self.ours, 4096) if ready else b""

    def write(self, data: bytes) -> None:
        # In the pieces that a UART's small buffer makes of it.
        for begin in range(0, len(data), 7):
            os.write(self.ours, data[begin : begin + 7])

    def close(self) -> None:
        os.close(self.ours)
        os.close(self.theirs)


@dataclass(kw_only=True)
class Copter:
    """What it is set to, what it does, and what it was told."""

    port: Port
    parameters: dict[str, float] = field(default_factory=lambda: {"GUID_OPTIONS": 8.0, "GUID_TIMEOUT": 0.5})
    deaf_to: int = 0  # questions for parameters that it does not hear
    mode: int = STABILIZE
    armed: bool = False
    heading_rad: float = 0.0
    north_m: float = 0.0
    ekf_flags: int = EKF_HAS
    intervals_us: dict[int, float] = field(default_factory=lambda: {mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1e6})
    counts: Counter[str] = field(default_factory=Counter[str])
    denied: list[int] = field(default_factory=list[int])
    setpoints: list[Any] = field(default_factory=list[Any])
    mav: mavlink.MAVLink = field(default_factory=lambda: mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    _due: dict[int, float] = field(default_factory=dict[int, float])

    def __post_init__(self) -> None:
        self.mav.robust_parsing = False  # a byte that belongs to no good packet is an error

    def send(self, message: Any) -> None:
        self.port.write(message.pack(self.mav))

    def pump(self) -> None:
        """Sends what is due and answers what has come."""
        now = time.monotonic()
        for message_id, interval_us in self.intervals_us.items():
            if now >= self._due.get(message_id, 0.0):
                self._due[message_id] = now + interval_us * 1e-6
                self.send(self.report(message_id))
        for message in self.mav.parse_buffer(self.port.read()) or []:
            self.counts[message.get_type()] += 1
            self.take(message)

    def until(self, done: Callable[[], bool], seconds: float = 10.0) -> None:
        deadline = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < deadline, (self.counts, self.mode, self.armed)
            self.pump()

    def boot_ms(self) -> int:
        return int(time.monotonic() * 1e3) % 2**32

    def report(self, message_id: int) -> Any:
        if message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            base_mode = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
                mavlink.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
            )
            state = mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY
            kind, firmware = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
            return mavlink.MAVLink_heartbeat_message(kind, firmware, base_mode, self.mode, state, 3)
        if message_id == mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED:
            return mavlink.MAVLink_local_position_ned_message(self.boot_ms(), self.north_m, 0.0, -2.0, 0.0, 0.0, 0.0)
        if message_id == mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION:
            half = self.heading_rad / 2
            q = (math.cos(half), 0.0, 0.0, math.sin(half))
            return mavlink.MAVLink_attitude_quaternion_message(self.boot_ms(), *q, 0.0, 0.0, 0.0)
        if message_id == mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE:
            landed = mavlink.MAV_LANDED_STATE_IN_AIR if self.armed else mavlink.MAV_LANDED_STATE_ON_GROUND
            return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, landed)
        if message_id == mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT:
            return mavlink.MAVLink_ekf_status_report_message(self.ekf_flags, 0.1, 0.1, 0.1, 0.1, 0.0)
        return mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 12_600, 150, 87, 0, 0, 0, 0, 0, 0)

    def tell(self, name: str) -> None:
        """As ArduPilot does: an integer is a float of the same value, whatever the type says."""
        real = name == "GUID_TIMEOUT"
        kind = mavlink.MAV_PARAM_TYPE_REAL32 if real else mavlink.MAV_PARAM_TYPE_INT32
        self.send(mavlink.MAVLink_param_value_message(name.encode(), self.parameters[name], kind, 1000, 65535))

    def take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "TIMESYNC" and message.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(time.monotonic_ns(), message.ts1))
        elif kind == "SET_ATTITUDE_TARGET":
            self.setpoints.append(message)
        elif kind == "PARAM_REQUEST_READ" and message.param_id in self.parameters:
            self.deaf_to -= 1
            if self.deaf_to < 0:
                self.tell(message.param_id)
        elif kind == "COMMAND_LONG":
            result = self.command(message)
            ack = (message.command, result, 0, 0, message.get_srcSystem(), message.get_srcComponent())
            self.send(mavlink.MAVLink_command_ack_message(*ack))

    def command(self, message: Any) -> int:
        if message.command == mavlink.MAV_CMD_DO_SET_MODE and int(message.param1) & 1:
            self.mode = int(message.param2)
        elif message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            if message.param1 == 1 and self.mode not in (GUIDED, GUIDED_NOGPS):
                return mavlink.MAV_RESULT_FAILED
            self.armed = message.param1 == 1
        elif message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            if int(message.param1) not in STREAMS:
                self.denied.append(int(message.param1))
                return mavlink.MAV_RESULT_DENIED
            self.intervals_us[int(message.param1)] = message.param2
        else:
            return mavlink.MAV_RESULT_UNSUPPORTED
        return mavlink.MAV_RESULT_ACCEPTED


def key_file(folder: Path, key: bytes) -> Path:
    """A signing key as the vehicle reads it: its hexadecimal digits."""
    path = folder / "mavlink.key"
    path.write_text(key.hex() + "\n")
    path.chmod(0o600)
    return path
