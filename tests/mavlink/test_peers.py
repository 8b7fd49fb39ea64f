"""Who may be the autopilot on a UDP port, against pymavlink's own packets."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v10 import ardupilotmega as mavlink1
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from wire import Wire

ROOT = Path(__file__).resolve().parents[2]
LINK = 'link = "udpin:127.0.0.1:14540"'
ARMED, DISARMED = 0x91, 0x11


class Sender:
    """Speaks to `link` from an address of this computer's own, as the ids that it is told."""

    def __init__(self, link: Wire, host: str, system: int = 1) -> None:
        self.link = link
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((host, 0))
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)

    def heartbeat(self, base_mode: int) -> None:
        kind, firmware = mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4
        message = mavlink.MAVLink_heartbeat_message(kind, firmware, base_mode, 0x03040000, 4, 3)
        self.socket.sendto(message.pack(self.mav), ("127.0.0.1", self.link.port))

    def attitude(self) -> None:
        message = mavlink.MAVLink_attitude_message(1000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self.socket.sendto(message.pack(self.mav), ("127.0.0.1", self.link.port))


def events_after(link: Wire, sender: Sender, base_mode: int) -> tuple[list[str], dict[str, Any]]:
    """What is told of the peer after the sender's heartbeats, and what is then known."""
    events: list[str] = []
    end = time.monotonic() + 5.0
    while not events:
        assert time.monotonic() < end, "nothing was told"
        sender.heartbeat(base_mode)
        time.sleep(0.01)
        read = link.read()
        events += read["peer_events"]
    return events, link.read()


@pytest.fixture
def link(example: Callable[[str], Path]) -> Iterator[Wire]:
    link = Wire(example("wire"), "udpin:0.0.0.0:0", "px4", "-", "127.0.0.5")
    yield link
    link.close()


def test_what_an_autopilot_streams_before_its_first_heartbeat_alarms_nobody(example: Callable[[str], Path]) -> None:
    link = Wire(example("wire"), "udpin:127.0.0.1:0", "px4")
    autopilot = Sender(link, "127.0.0.1")
    told: list[str] = []
    for _ in range(20):
        autopilot.attitude()
        time.sleep(0.01)
        told += link.read()["peer_events"]
    end = time.monotonic() + 5.0
    while not (read := link.read())["connected"]:
        assert time.monotonic() < end
        autopilot.heartbeat(DISARMED)
        time.sleep(0.01)
        told += read["peer_events"]
    link.close()
    assert told == []


def test_who_speaks_first_is_not_believed_where_another_is_pinned(link: Wire) -> None:
    events, read = events_after(link, Sender(link, "127.0.0.66"), ARMED)
    assert len(events) == 1 and "127.0.0.66" in events[0] and "not believed" in events[0]
    assert not read["connected"] and not read["armed"]


def test_a_second_sender_beside_the_pinned_one_is_named_once(link: Wire) -> None:
    autopilot, intruder = Sender(link, "127.0.0.5"), Sender(link, "127.0.0.66")
    end = time.monotonic() + 5.0
    while not link.read()["connected"]:
        assert time.monotonic() < end
        autopilot.heartbeat(DISARMED)
        time.sleep(0.01)
    events, read = events_after(link, intruder, ARMED)
    assert len(events) == 1 and "127.0.0.66" in events[0]
    assert read["connected"] and not read["armed"]
    beside = Sender(link, "127.0.0.5", system=9)
    beside.socket = autopilot.socket
    other, read = events_after(link, beside, ARMED)
    assert len(other) == 1 and "system 9" in other[0], "other ids at its address"
    assert not read["armed"]


def test_a_px4_that_begins_in_mavlink_1_hears_us_and_changes_to_mavlink_2(link: Wire) -> None:
    autopilot, other = Sender(link, "127.0.0.5"), Sender(link, "127.0.0.66")
    first = mavlink1.MAVLink(None, srcSystem=1, srcComponent=1)
    for sender in (autopilot, other):
        sender.socket.setblocking(False)
    heard, end = b"", time.monotonic() + 5.0
    while not heard:
        assert time.monotonic() < end, "nothing was said to it"
        for sender in (autopilot, other):
            kind, firmware = mavlink1.MAV_TYPE_QUADROTOR, mavlink1.MAV_AUTOPILOT_PX4
            message = mavlink1.MAVLink_heartbeat_message(kind, firmware, DISARMED, 0x03040000, 4, 3)
            sender.socket.sendto(message.pack(first), ("127.0.0.1", link.port))
        time.sleep(0.01)
        with contextlib.suppress(BlockingIOError):
            heard = autopilot.socket.recv(1000)
    assert heard[0] == 0xFD and not link.read()["connected"]
    with pytest.raises(BlockingIOError):
        other.socket.recv(1000)
    while not link.read()["connected"]:
        assert time.monotonic() < end + 5.0
        autopilot.heartbeat(DISARMED)
        time.sleep(0.01)


def vehicle_file(folder: Path, link: str) -> Path:
    """The shipped vehicle's, with another link."""
    text = (ROOT / "air/vehicles/sim.toml").read_text()
    assert LINK in text
    path = folder / "vehicle.toml"
    text = text.replace(LINK, link).replace('"../models', f'"{ROOT / "air/models"}')
    path.write_text(text.replace('"tuning.toml"', f'"{ROOT / "air/vehicles/tuning.toml"}"'))
    return path


@pytest.mark.parametrize(
    ("link", "named"),
    [
        ('link = "udpin:0.0.0.0:0"', ["signing_key_file", "`peer`"]),
        ('link = "udpin:0.0.0.0:0"\npeer = "192.168.1.5"', ["signing_key_file"]),
        ('link = "udpin:127.0.0.1:0"', []),
    ],
)
def test_check_warns_of_an_open_port_without_a_key(air: Path, tmp_path: Path, link: str, named: list[str]) -> None:
    config = vehicle_file(tmp_path, link)
    command = [str(air), "check", "--config", str(config), "--log-dir", str(tmp_path), "--wait", "0.1"]
    findings = tmp_path / "findings.json"
    subprocess.run([*command, "--json", str(findings)], capture_output=True, timeout=60)
    conditions = json.loads(findings.read_text())["conditions"]
    warnings = [c["text"] for c in conditions if c["name"] == "mavlink" and c["level"] == "warning"]
    assert [word for text in warnings for word in ("signing_key_file", "`peer`") if word in text] == named


@pytest.mark.parametrize(
    ("link", "named"),
    [
        ('link = "udpin:0.0.0.0:0"\npeer = "px4.local"', "192.168.1.5:14550"),
        ('link = "udpout:10.0.0.1:14580"\npeer = "10.0.0.1"', "leave it out"),
    ],
)
def test_a_peer_that_cannot_be_is_refused_in_one_line(air: Path, tmp_path: Path, link: str, named: str) -> None:
    config = vehicle_file(tmp_path, link)
    done = subprocess.run([str(air), "run", "--config", str(config)], capture_output=True, text=True, timeout=30)
    assert done.returncode != 0
    assert named in done.stderr.strip().splitlines()[-1], done.stderr


def test_a_start_with_an_open_port_says_so(air: Path, tmp_path: Path) -> None:
    config = vehicle_file(tmp_path, 'link = "udpin:0.0.0.0:0"')
    command = [str(air), "run", "--config", str(config), "--log-dir", str(tmp_path), "--listen", "tcp/127.0.0.1:0"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    assert process.stdout is not None
    try:
        said = next((line for line in process.stdout if "is not signed" in line), None)
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
    assert said is not None and "WARN" in said and "signing_key_file" in said
