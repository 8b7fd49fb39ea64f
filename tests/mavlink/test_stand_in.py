"""The autopilot stand-in in real time, spoken to by pymavlink as a ground tool would."""

from __future__ import annotations

import math
import socket
import subprocess
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink  # `common` with CURRENT_MODE

OFFBOARD, HOLD, LAND = 0x00060000, 0x03040000, 0x06040000
EVENT_ID, FAILSAFE_ENTERED = 410, 31382480


class Client:
    """A companion computer made of a socket and pymavlink."""

    def __init__(self, program: Path) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.002)
        here = f"127.0.0.1:{self.socket.getsockname()[1]}"
        command = [program, "127.0.0.1:0", here]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        self.address = ("127.0.0.1", int(self.process.stdout.readline()))
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
        self.thrust: Callable[[], float] | None = None
        self.height = 0.0
        self.climb = 0.0
        self.mode = 0
        self.armed = False
        self.counts: Counter[str] = Counter()
        self.acks: list[tuple[int, int]] = []
        self.events: list[int] = []
        self._next_setpoint = 0.0

    def send(self, message: Any) -> None:
        self.socket.sendto(message.pack(self.mav), self.address)

    def pump(self) -> None:
        """Sends a setpoint if one is due (50 Hz) and takes one datagram."""
        now = time.monotonic()
        if self.thrust is not None and now >= self._next_setpoint:
            self._next_setpoint = now + 0.02
            yaw = math.pi / 2  # it stands facing east
            q = [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]
            self.send(mavlink.MAVLink_set_attitude_target_message(0, 1, 1, 7, q, 0.0, 0.0, 0.0, self.thrust()))
        try:
            data = self.socket.recv(2048)
        except TimeoutError:
            return
        if int.from_bytes(data[7:10], "little") == EVENT_ID:  # a message that pymavlink does not have yet
            self.counts["EVENT"] += 1
            self.events.append(int.from_bytes(data[10:14], "little"))
            return
        message: Any = self.mav.decode(bytearray(data))  # raises on a wrong checksum or length
        kind = message.get_type()
        self.counts[kind] += 1
        if kind == "LOCAL_POSITION_NED":
            self.height, self.climb = -message.z, -message.vz
        elif kind == "HEARTBEAT":
            self.mode, self.armed = message.custom_mode, bool(message.base_mode & 128)
        elif kind == "CURRENT_MODE":
            self.mode = message.custom_mode
        elif kind == "COMMAND_ACK":
            self.acks.append((message.command, message.result))

    def until(self, done: Callable[[], bool], seconds: float) -> float:
        start = time.monotonic()
        while not done():
            self.pump()
            assert time.monotonic() - start < seconds, (self.mode, self.armed, self.height, self.counts)
        return time.monotonic() - start

    def run(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.pump()

    def ask(self, command: int, *params: float, component: int = 1) -> int | None:
        """The result; none: no ack within half a second."""
        self.acks.clear()
        values = [*params, *[0.0] * (7 - len(params))]
        self.send(mavlink.MAVLink_command_long_message(1, component, command, 0, *values))
        end = time.monotonic() + 0.5
        while time.monotonic() < end:
            self.pump()
            if self.acks:
                assert self.acks[0][0] == command
                return self.acks[0][1]
        return None

    def close(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()
        assert self.process.wait(timeout=5) == 0
        self.socket.close()


@pytest.fixture
def client(example: Callable[[str], Path]) -> Iterator[Client]:
    client = Client(example("px4"))
    client.until(lambda: client.counts["HEARTBEAT"] > 0, 5.0)
    yield client
    client.close()


def test_its_streams_keep_the_measured_rates(client: Client) -> None:
    client.run(0.5)
    client.counts.clear()
    client.run(4.0)
    rates_hz = {"ATTITUDE": 100, "ATTITUDE_QUATERNION": 50, "HIGHRES_IMU": 50, "ODOMETRY": 30, "TIMESYNC": 10}
    for kind, hz in rates_hz.items():
        assert client.counts[kind] == pytest.approx(hz * 4.0, rel=0.1), kind


def test_a_wrong_component_gets_no_answer(client: Client) -> None:
    assert client.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1, component=42) is None
    assert client.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED


def test_a_flight_with_a_lost_stream_ends_landed_and_disarmed(client: Client) -> None:
    raise_modes = (mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 436, 100_000)
    assert client.ask(*raise_modes) == mavlink.MAV_RESULT_ACCEPTED
    assert client.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 6) == mavlink.MAV_RESULT_ACCEPTED
    refused = client.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
    assert refused == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
    client.thrust = lambda: min(max(0.41 + 0.2 * (1.5 - client.height) - 0.15 * client.climb, 0.2), 0.6)
    client.run(0.3)
    assert client.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1) == mavlink.MAV_RESULT_ACCEPTED
    client.until(lambda: client.height > 1.2 and client.mode == OFFBOARD, 10.0)
    assert client.ask(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED

    client.thrust, stream = None, client.thrust
    lost = client.until(lambda: client.mode == LAND, 3.0)
    assert 0.5 < lost < 1.0
    assert FAILSAFE_ENTERED in client.events
    client.thrust = stream
    client.until(lambda: client.mode == OFFBOARD, 1.0)

    assert client.ask(mavlink.MAV_CMD_DO_SET_MODE, 1, 4, 6) == mavlink.MAV_RESULT_ACCEPTED
    client.thrust = None
    client.until(lambda: not client.armed, 15.0)
    assert client.height < 0.2
