"""The link's bytes against pymavlink, an independent implementation; expected attitudes are computed here, in NED."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.quaternion import QuaternionBase
from wire import Wire

HEADINGS_DEG = {"north": 0.0, "east": 90.0, "south": 180.0, "west": -90.0}
TILTS_DEG = {"level": (0.0, 0.0), "nose down": (0.0, -20.0), "right side down": (15.0, 0.0), "both": (15.0, 20.0)}


class Peer:
    """The example `wire` and, beside it, an autopilot made of a socket and pymavlink."""

    def __init__(self, program: Path) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(5.0)
        self.wire = Wire(program, f"udpout:127.0.0.1:{self.socket.getsockname()[1]}")
        self.tell = self.wire.tell
        self.address = ("127.0.0.1", self.wire.port)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)

    def send(self, message: Any) -> None:
        self.socket.sendto(message.pack(self.mav), self.address)

    def receive(self, kind: str) -> Any:
        """The next message of a kind; every datagram must be exactly one valid MAVLink 2 packet."""
        deadline = time.monotonic() + 5.0
        while time.monotonic() < deadline:
            data = self.socket.recv(2048)
            assert data[0] == 0xFD
            message = self.mav.decode(bytearray(data))  # raises on a wrong checksum or length
            assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 191)
            if message.get_type() == kind:
                return message
        raise AssertionError(f"no {kind} came")

    def until(self, done: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        deadline = time.monotonic() + 5.0
        while time.monotonic() < deadline:
            read = self.tell("read")
            if done(read):
                return read
            time.sleep(0.01)
        raise AssertionError("it was never read")

    def close(self) -> None:
        self.wire.close()
        self.socket.close()


@pytest.fixture
def peer(example: Callable[[str], Path]) -> Iterator[Peer]:
    peer = Peer(example("wire"))
    yield peer
    peer.close()


def about(axis: int, radians: float) -> np.ndarray:
    """Rotation about one axis as (w, x, y, z)."""
    q = np.zeros(4)
    q[0], q[1 + axis] = math.cos(radians / 2), math.sin(radians / 2)
    return q


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    w = a[0] * b[0] - a[1:] @ b[1:]
    return np.concatenate([[w], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def enu_attitude(heading_deg: float, roll_deg: float, pitch_deg: float) -> np.ndarray:
    """ENU from FLU: yaw counts from east, anticlockwise, and a nose that is up is a negative turn about y (left)."""
    yaw = about(2, math.radians(90.0 - heading_deg))
    return product(product(yaw, about(1, -math.radians(pitch_deg))), about(0, math.radians(roll_deg)))


def ned_attitude(heading_deg: float, roll_deg: float, pitch_deg: float) -> np.ndarray:
    """NED from FRD, by pymavlink's own mathematics."""
    return np.array(QuaternionBase([math.radians(a) for a in (roll_deg, pitch_deg, heading_deg)]).q)


def same_rotation(a: np.ndarray, b: np.ndarray, tolerance: float = 1e-5) -> bool:
    return bool(min(np.abs(a - b).max(), np.abs(a + b).max()) < tolerance)


@pytest.mark.parametrize("heading", HEADINGS_DEG)
@pytest.mark.parametrize("tilt", TILTS_DEG)
def test_a_setpoint_is_the_same_attitude_in_ned_and_frd(peer: Peer, heading: str, tilt: str) -> None:
    angles = (HEADINGS_DEG[heading], *TILTS_DEG[tilt])
    q = enu_attitude(*angles)
    assert peer.tell(f"setpoint {q[0]} {q[1]} {q[2]} {q[3]} 0.375") == {"error": None}
    message = peer.receive("SET_ATTITUDE_TARGET")
    assert same_rotation(np.array(message.q), ned_attitude(*angles)), (message.q, ned_attitude(*angles))
    assert message.type_mask == 7
    assert message.thrust == 0.375
    assert (message.target_system, message.target_component) == (1, 1)


@pytest.mark.parametrize(
    ("request_name", "command", "params"),
    [
        ("offboard", mavlink.MAV_CMD_DO_SET_MODE, (1, 6, 0)),
        ("hand-back", mavlink.MAV_CMD_DO_SET_MODE, (1, 4, 6)),
        ("arm", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1, 0, 0)),
        ("disarm", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0, 0, 0)),
        ("disarm-anyway", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0, 21196, 0)),
    ],
)
def test_a_request_is_the_command_that_px4_takes(
    peer: Peer, request_name: str, command: int, params: tuple[int, int, int]
) -> None:
    peer.tell(f"request {request_name}")
    message = peer.receive("COMMAND_LONG")
    assert (message.command, message.param1, message.param2, message.param3) == (command, *params)
    assert (message.target_system, message.target_component) == (1, 1)
    peer.send(mavlink.MAVLink_command_ack_message(command, mavlink.MAV_RESULT_DENIED))
    read = peer.until(lambda read: bool(read["acks"]))
    assert "denied" in read["acks"][0][1]


def test_the_heartbeat_is_a_companion_computers(peer: Peer) -> None:
    message = peer.receive("HEARTBEAT")
    assert (message.type, message.autopilot) == (mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID)


def heartbeat(custom_mode: int, base_mode: int) -> Any:
    return mavlink.MAVLink_heartbeat_message(2, 12, base_mode, custom_mode, mavlink.MAV_STATE_ACTIVE, 3)


def test_contact_raises_the_streams_one_after_another(peer: Peer) -> None:
    peer.send(heartbeat(0x03040000, 29))
    asked: dict[int, float] = {}
    checks = peer.receive("COMMAND_LONG")
    assert checks.command == mavlink.MAV_CMD_RUN_PREARM_CHECKS
    peer.send(mavlink.MAVLink_command_ack_message(checks.command, mavlink.MAV_RESULT_ACCEPTED))
    while len(asked) < 6:
        message = peer.receive("COMMAND_LONG")
        if message.command == mavlink.MAV_CMD_RUN_PREARM_CHECKS:
            continue
        assert message.command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        asked[int(message.param1)] = message.param2
        peer.send(mavlink.MAVLink_command_ack_message(message.command, mavlink.MAV_RESULT_ACCEPTED))
    odometry, quaternion, imu = 331, 31, 105
    assert asked == {odometry: 1e4, quaternion: 1e4, imu: 1e4, 436: 1e5, 245: 1e5, 230: 1e5}


def test_timesync_is_asked_and_answered(peer: Peer) -> None:
    message = peer.receive("TIMESYNC")
    assert message.tc1 == 0
    assert message.ts1 > 0
    peer.send(mavlink.MAVLink_timesync_message(5_000_000_000, message.ts1))
    read = peer.until(lambda read: read["round_trip_s"] is not None)
    assert 0.0 < read["round_trip_s"] < 1.0
    peer.send(mavlink.MAVLink_timesync_message(0, 77))
    while (message := peer.receive("TIMESYNC")).tc1 == 0:
        pass
    assert message.ts1 == 77


@pytest.mark.parametrize(("mode", "name"), [(0x00060000, "OFFBOARD"), (0x03040000, "AUTO.LOITER")])
@pytest.mark.parametrize("armed", [False, True])
def test_mode_and_arming_are_read_from_the_heartbeat(peer: Peer, mode: int, name: str, armed: bool) -> None:
    peer.send(heartbeat(mode, 0x91 if armed else 0x11))
    read = peer.until(lambda read: read["connected"])
    assert (read["mode"], read["armed"], read["offboard"]) == (name, armed, name == "OFFBOARD")


NAN = float("nan")


def odometry(child_frame: int, velocity: tuple[float, float, float], q: np.ndarray, frame: int = 1) -> Any:
    return mavlink.MAVLink_odometry_message(
        1_000_000, frame, child_frame, 10.0, 20.0, -30.0, list(q), *velocity, 0.1, 0.2, -0.3,
        [NAN] * 21, [NAN] * 21, 15, mavlink.MAV_ESTIMATOR_TYPE_AUTOPILOT,
    )  # fmt: skip


@pytest.mark.parametrize("heading", HEADINGS_DEG)
@pytest.mark.parametrize("child", ["ned", "frd"])
def test_odometry_is_read_in_the_frame_that_it_names(peer: Peer, heading: str, child: str) -> None:
    angles = (HEADINGS_DEG[heading], 5.0, -10.0)
    q = ned_attitude(*angles)
    vel_ned = np.array([3.0, -1.0, -2.0])
    vel_frd = np.array(QuaternionBase(list(q)).dcm).T @ vel_ned
    frame, velocity = (1, vel_ned) if child == "ned" else (mavlink.MAV_FRAME_BODY_FRD, vel_frd)
    peer.send(heartbeat(0x00060000, 0x91))
    peer.send(odometry(frame, tuple(velocity), q))
    read = peer.until(lambda read: read["odometry"] is not None)["odometry"]
    assert np.allclose(read["pos_world"], [20.0, 10.0, 30.0], atol=1e-5)
    assert np.allclose(read["vel_world"], [-1.0, 3.0, 2.0], atol=1e-5)
    assert np.allclose(read["ang_vel_body"], [0.1, -0.2, 0.3], atol=1e-6)
    assert same_rotation(np.array(read["world_from_body"]), enu_attitude(*angles))
    assert read["reset_counter"] == 15


def test_odometry_that_cannot_be_used_is_counted_and_not_passed_on(peer: Peer) -> None:
    q = ned_attitude(0.0, 0.0, 0.0)
    peer.send(heartbeat(0x00060000, 0x91))
    peer.send(odometry(1, (NAN, 0.0, 0.0), q))
    peer.send(odometry(1, (0.0, 0.0, 0.0), q * 0.0))
    peer.send(odometry(1, (0.0, 0.0, 0.0), q, frame=mavlink.MAV_FRAME_LOCAL_FRD))
    read = peer.until(lambda read: read["not_finite"] == 2 and read["odometry_frame"] == 1)
    assert read["odometry"] is None


def test_position_and_attitude_messages_do_where_there_is_no_odometry(peer: Peer) -> None:
    q = ned_attitude(90.0, 0.0, 0.0)
    peer.send(heartbeat(0x00060000, 0x91))
    peer.send(mavlink.MAVLink_local_position_ned_message(1000, 1.0, 2.0, -3.0, 4.0, 5.0, -6.0))
    peer.send(mavlink.MAVLink_attitude_quaternion_message(1000, q[0], q[1], q[2], q[3], 0.1, 0.2, 0.3))
    read = peer.until(lambda read: read["odometry"] is not None)["odometry"]
    assert np.allclose(read["pos_world"], [2.0, 1.0, 3.0], atol=1e-5)
    assert np.allclose(read["vel_world"], [5.0, 4.0, 6.0], atol=1e-5)
    assert same_rotation(np.array(read["world_from_body"]), np.array([1.0, 0.0, 0.0, 0.0]))
