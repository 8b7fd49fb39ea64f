"""The autopilot's telemetry radio: heard over real UDP, never spoken to."""

from __future__ import annotations

import os
import socket
import struct
import time
import tty
from collections.abc import Callable
from pathlib import Path

import pytest
from goshawk_dashboards.state.views import AutopilotView
from goshawk_ground.link import LinkError
from goshawk_ground.link.radio import AutopilotState, Radio
from goshawk_proto import goshawk_pb2 as pb
from pymavlink.dialects.v20 import common as mavlink

RECORDED = Path(__file__).resolve().parents[3] / "tests/data/px4-sih-offboard.tlog"
OFFBOARD = 6 << 16
"""PX4's custom mode."""


def udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Autopilot:
    """Speaks MAVLink to a port and hears whatever comes back."""

    def __init__(self, port: int) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self._peer = ("127.0.0.1", port)
        self.mav = mavlink.MAVLink(self, srcSystem=1, srcComponent=1)

    def write(self, data: bytes) -> None:
        self.socket.sendto(data, self._peer)

    def heartbeat(self, status: int = mavlink.MAV_STATE_ACTIVE) -> None:
        armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        self.mav.heartbeat_send(mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, armed, OFFBOARD, status)

    def battery(self, percent: int, millivolts: int) -> None:
        self.mav.sys_status_send(0, 0, 0, 0, millivolts, -1, percent, 0, 0, 0, 0, 0, 0)

    def heard(self) -> list[bytes]:
        got: list[bytes] = []
        while True:
            try:
                got.append(self.socket.recv(2048))
            except BlockingIOError:
                return got


def wait_for(radio: Radio, condition: Callable[[AutopilotView], bool], speak: Callable[[], None]) -> AutopilotView:
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        speak()
        view = radio.view()
        if condition(view):
            return view
        time.sleep(0.05)
    raise AssertionError(f"never: {radio.view()}")


def test_mode_battery_and_texts_are_heard_and_nothing_is_ever_sent() -> None:
    port = udp_port()
    with Radio(f"udpin:127.0.0.1:{port}") as radio:
        assert radio.view().age_s is None
        autopilot = Autopilot(port)

        def speak() -> None:
            autopilot.heartbeat()
            autopilot.battery(61, 15120)
            autopilot.mav.statustext_send(mavlink.MAV_SEVERITY_CRITICAL, b"Low battery")

        view = wait_for(radio, lambda v: v.battery_fraction is not None and bool(v.texts), speak)
        assert (view.mode, view.armed, view.failsafe) == ("OFFBOARD", True, False)
        assert view.battery_fraction == pytest.approx(0.61)
        assert view.battery_v == pytest.approx(15.12)
        assert view.texts[0] == (pb.SEVERITY_ERROR, "Low battery")
        wait_for(radio, lambda v: v.rate_hz > 5.0, speak)
    assert autopilot.heard() == []


def test_pymavlink_itself_cannot_send_by_the_connection() -> None:
    with Radio(f"udpin:127.0.0.1:{udp_port()}") as radio, pytest.raises(PermissionError):
        # What no caller can reach is tried from within.
        radio._connection.mav.heartbeat_send(6, 8, 0, 0, 0)  # pyright: ignore[reportPrivateUsage]


def test_a_critical_heartbeat_is_a_failsafe() -> None:
    port = udp_port()
    with Radio(f"udpin:127.0.0.1:{port}") as radio:
        autopilot = Autopilot(port)
        wait_for(radio, lambda v: v.failsafe, lambda: autopilot.heartbeat(mavlink.MAV_STATE_CRITICAL))


def test_rubbish_and_other_speakers_change_nothing() -> None:
    port = udp_port()
    with Radio(f"udpin:127.0.0.1:{port}") as radio:
        autopilot, camera = Autopilot(port), Autopilot(port)
        camera.mav = mavlink.MAVLink(camera, srcSystem=1, srcComponent=100)

        def speak() -> None:
            autopilot.socket.sendto(b"\xfd\x09rubbish\x00\xff", ("127.0.0.1", port))
            camera.battery(5, 9000)
            autopilot.heartbeat()

        view = wait_for(radio, lambda v: v.age_s is not None, speak)
        assert view.battery_fraction is None


def test_loss_is_counted_from_the_sequence_numbers() -> None:
    encoder = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    decoder = mavlink.MAVLink(None)
    state = AutopilotState("x")
    for k in range(300):
        packed = mavlink.MAVLink_attitude_message(k, 0, 0, 0, 0, 0, 0).pack(encoder)
        encoder.seq = (encoder.seq + 1) % 256
        if k % 4:
            state.take(decoder.decode(bytearray(packed)), "", 0.01 * k)
    loss = state.view(3.0).loss_fraction
    assert loss == pytest.approx(0.25, abs=0.01)


@pytest.mark.parametrize("source", ["", "14550", "udpout:1.2.3.4:14550", "udpin:0.0.0.0", "http://x"])
def test_a_source_that_cannot_be_one_is_refused_at_once(source: str) -> None:
    with pytest.raises(LinkError, match="source"):
        Radio(source)


def test_a_busy_port_is_said_at_once() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        with pytest.raises(LinkError, match="cannot listen"):
            Radio(f"udpin:127.0.0.1:{taken.getsockname()[1]}")


def test_a_source_that_breaks_the_library_is_trouble_that_is_told() -> None:
    with pytest.raises(LinkError, match="cannot listen"):
        Radio("udpin:127.0.0.1:99999")
    with Radio("tcp:127.0.0.1:99999") as radio:
        end = time.monotonic() + 10.0
        while not radio.view().trouble and time.monotonic() < end:
            time.sleep(0.05)
        assert radio.view().trouble


def test_a_recorded_px4_is_understood() -> None:
    port = udp_port()
    with Radio(f"udpin:127.0.0.1:{port}") as radio, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        seen: set[str] = set()
        for k, packet in enumerate(packets(RECORDED.read_bytes())):
            sender.sendto(packet, ("127.0.0.1", port))
            if k % 20 == 0:
                time.sleep(0.01)
                seen.add(radio.view().mode)
        view = radio.view()
    assert "OFFBOARD" in seen
    assert view.battery_v is not None
    assert view.loss_fraction is not None
    assert view.loss_fraction < 0.05


def packets(log: bytes, most: int = 6000) -> list[bytes]:
    """The MAVLink packets of a tlog: each is preceded by 8 bytes of time."""
    found, at = list[bytes](), 0
    while at + 20 < len(log) and len(found) < most:
        magic, length = struct.unpack_from("BB", log, at + 8)
        size = length + (12 if magic == 0xFD else 8)
        if magic == 0xFD and log[at + 10] & 1:
            size += 13
        found.append(log[at + 8 : at + 8 + size])
        at += 8 + size
    return found


def test_a_serial_radio_is_heard_and_a_port_that_goes_away_is_told() -> None:
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(packer)
    try:
        with Radio(f"{os.ttyname(theirs)},57600") as radio:

            def speak() -> None:
                os.write(ours, beat)

            heard = wait_for(radio, lambda v: v.age_s is not None, speak)
            assert not heard.trouble
            os.set_blocking(ours, False)
            with pytest.raises(BlockingIOError):
                os.read(ours, 1)
            os.close(ours)
            ours = -1
            assert wait_for(radio, lambda v: bool(v.trouble), lambda: None).trouble
    finally:
        for end in (ours, theirs):
            if end >= 0:
                os.close(end)
