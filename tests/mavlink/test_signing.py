"""MAVLink 2 signing against pymavlink's own."""

from __future__ import annotations

import hashlib
import itertools
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from copter import key_file
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from wire import Wire

KEY = hashlib.sha256(b"the owl flies at dusk").digest()  # as MAVProxy and QGroundControl make one of a passphrase
EPOCH_S = 1_420_070_400  # 2015


def stamp_now() -> int:
    return int((time.time() - EPOCH_S) * 1e5)


class Autopilot:
    """A UDP peer that signs; `link` listens for it, and learns where it is."""

    def __init__(self, link: Wire, key: bytes | None, stamp: int) -> None:
        self.link = link
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.02)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        if key is not None:
            signing = self.mav.signing
            signing.secret_key, signing.timestamp, signing.link_id, signing.sign_outgoing = key, stamp, 3, True

    def send(self, message: Any) -> bytes:
        packed = message.pack(self.mav)
        self.socket.sendto(packed, ("127.0.0.1", self.link.port))
        return packed

    def heartbeat(self) -> bytes:
        kind, firmware = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4
        return self.send(mavlink.MAVLink_heartbeat_message(kind, firmware, 0x11, 0x03040000, 4, 3))

    def receive(self) -> Any:
        """The next message, believed by pymavlink, which raises at a bad signature."""
        end = time.monotonic() + 5.0
        while time.monotonic() < end:
            try:
                return self.mav.decode(bytearray(self.socket.recv(2048)))
            except TimeoutError:
                continue
        raise AssertionError("nothing came")

    def until(self, done: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        end = time.monotonic() + 5.0
        while not done(read := self.link.read()):
            assert time.monotonic() < end, read
            time.sleep(0.005)
        return read


@pytest.fixture
def link(example: Callable[[str], Path], tmp_path: Path) -> Iterator[Wire]:
    link = Wire(example("wire"), "udpin:127.0.0.1:0", "px4", key_file(tmp_path, KEY))
    yield link
    link.close()


def test_both_believe_what_the_other_signs(link: Wire) -> None:
    autopilot = Autopilot(link, KEY, stamp_now())
    autopilot.heartbeat()
    autopilot.until(lambda read: read["connected"])
    seen: set[str] = set()
    while not {"HEARTBEAT", "TIMESYNC", "COMMAND_LONG"} <= seen:
        message = autopilot.receive()
        assert message.get_signed()
        seen.add(message.get_type())
    assert link.tell("setpoint 1 0 0 0 0.5") == {"error": None}
    while autopilot.receive().get_type() != "SET_ATTITUDE_TARGET":
        pass


def test_our_stamps_are_the_time_since_2015_and_rise(link: Wire) -> None:
    autopilot = Autopilot(link, KEY, stamp_now())
    autopilot.heartbeat()
    streams: dict[int, list[int]] = {}  # by link id: the setpoints' thread has a stream of its own
    for _ in range(60):
        data = autopilot.receive().get_msgbuf()
        streams.setdefault(data[-13], []).append(int.from_bytes(bytes(data[-12:-6]), "little"))
        link.tell("setpoint 1 0 0 0 0.5")
    assert len(streams) == 2
    for stamps in streams.values():
        assert all(a < b for a, b in itertools.pairwise(stamps))
        assert abs(stamps[-1] - stamp_now()) < 5e5


def test_another_key_is_refused_both_ways_and_told(link: Wire) -> None:
    stranger = Autopilot(link, hashlib.sha256(b"another").digest(), stamp_now())
    stranger.heartbeat()
    read = stranger.until(lambda read: read["bad_signature"] == 1)
    assert not read["connected"]
    assert "another key" in read["problem"]
    autopilot = Autopilot(link, KEY, stamp_now())
    autopilot.heartbeat()
    autopilot.until(lambda read: read["connected"])
    autopilot.mav.signing.secret_key = hashlib.sha256(b"another").digest()
    with pytest.raises(mavlink.MAVError, match="signature"):
        autopilot.receive()


def test_what_is_not_signed_is_refused_and_told(link: Wire) -> None:
    stranger = Autopilot(link, None, 0)
    stranger.heartbeat()
    read = stranger.until(lambda read: read["unsigned"] == 1)
    assert not read["connected"]
    assert "not signed" in read["problem"]
    # In contact, a forged mode from the very address of the autopilot changes nothing.
    autopilot = Autopilot(link, KEY, stamp_now())
    autopilot.heartbeat()
    autopilot.until(lambda read: read["connected"])
    autopilot.mav.signing.sign_outgoing = False
    autopilot.send(mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0x91, 0x00060000, 4, 3))
    autopilot.send(mavlink.MAVLink_radio_status_message(200, 200, 100, 10, 10, 0, 0))  # a radio's own: no reproach
    read = autopilot.until(lambda read: read["unsigned"] == 2)
    assert (read["mode"], read["armed"], read["offboard"]) == ("AUTO.LOITER", False, False)


def test_a_repeated_packet_is_refused(link: Wire) -> None:
    autopilot = Autopilot(link, KEY, stamp_now())
    recorded = autopilot.heartbeat()
    autopilot.until(lambda read: read["connected"])
    autopilot.socket.sendto(recorded, ("127.0.0.1", link.port))
    autopilot.until(lambda read: read["stale_signature"] == 1)


def test_an_autopilot_without_the_time_learns_it_from_us(link: Wire) -> None:
    autopilot = Autopilot(link, KEY, 1_000)  # its clock stands at 2015, as without GPS
    autopilot.heartbeat()
    read = autopilot.until(lambda read: read["stale_signature"] == 1)
    assert not read["connected"]
    autopilot.receive()  # pymavlink, as ArduPilot, goes on from the newest stamp that it has believed
    autopilot.heartbeat()
    autopilot.until(lambda read: read["connected"])


def test_without_a_key_signed_packets_are_taken(example: Callable[[str], Path]) -> None:
    link = Wire(example("wire"), "udpin:127.0.0.1:0", "px4")
    autopilot = Autopilot(link, KEY, stamp_now())
    autopilot.heartbeat()
    autopilot.until(lambda read: read["connected"])
    with pytest.raises(mavlink.MAVError, match="signature"):
        autopilot.receive()
    link.close()


@pytest.mark.parametrize("text", ["", "the owl flies at dusk", "0" * 64])
def test_a_file_that_is_no_key_is_named(air: Path, tmp_path: Path, text: str) -> None:
    root = Path(__file__).resolve().parents[2]
    (tmp_path / "mavlink.key").write_text(text)
    config = tmp_path / "vehicle.toml"
    vehicle = (root / "air/vehicles/sim.toml").read_text().replace('"../models', f'"{root / "air/models"}')
    vehicle = vehicle.replace('"tuning.toml"', f'"{root / "air/vehicles/tuning.toml"}"')
    config.write_text(vehicle.replace("# signing_key_file", "signing_key_file"))
    command = [str(air), "run", "--config", str(config), "--log-dir", str(tmp_path), "--mavlink-bind", "127.0.0.1:0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30)
    assert done.returncode != 0
    line = done.stderr.strip().splitlines()[-1]
    assert "mavlink.key" in line and "key" in line, done.stderr
