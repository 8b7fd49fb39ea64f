"""Who may be the autopilot on a UDP port, against pymavlink's own packets."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from wire import Wire

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
