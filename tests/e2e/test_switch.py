"""The pilot's switch, by RC_CHANNELS slipped into the stand-in's own stream: it starts, holds, goes on, stops."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import threading
import time
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any

import pytest
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.link import GroundLink
from goshawk_proto import goshawk_pb2 as pb
from pymavlink.dialects.v20 import common as mavlink
from rig import BIN, Rig, copied, free_port

STOP, HOLD, START = 1000, 1500, 1950
SWITCH = """
[switch]
channel = 8
start_us = [1750, 2100]
hold_us = [1400, 1600]
stop_us = [900, 1250]
"""
CHASING = {pb.MODE_TRACK, pb.MODE_SEARCH}


class Receiver:
    """Between the autopilot and the vehicle: passes all on, and adds what the pilot's radio says."""

    def __init__(self, vehicle_port: int) -> None:
        self.port = free_port(socket.SOCK_DGRAM)
        self.inner = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.inner.bind(("127.0.0.1", self.port))
        self.inner.settimeout(0.01)
        self.outer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.outer.connect(("127.0.0.1", vehicle_port))
        self.outer.setblocking(False)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.pulse_us: int | None = None
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def close(self) -> None:
        self.ended.set()
        self.thread.join()

    def _run(self) -> None:
        autopilot: tuple[str, int] | None = None
        due = time.monotonic()
        while not self.ended.is_set():
            with contextlib.suppress(TimeoutError, ConnectionRefusedError):
                data, autopilot = self.inner.recvfrom(65536)
                self.outer.send(data)
            with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
                while autopilot is not None:
                    self.inner.sendto(self.outer.recv(65536), autopilot)
            if self.pulse_us is not None and autopilot is not None and time.monotonic() > due:
                due = time.monotonic() + 0.05
                none = [65535] * 10
                channels: list[Any] = [0, 8, *[1500] * 7, self.pulse_us, *none, 255]
                message: Any = mavlink.MAVLink_rc_channels_message(*channels)
                with contextlib.suppress(ConnectionRefusedError):
                    self.outer.send(message.pack(self.mav))


@pytest.fixture
def radio(rig: Rig) -> Iterator[Receiver]:
    receiver = Receiver(rig.mavlink_port)
    yield receiver
    receiver.close()


def reach(link: GroundLink, rig: Rig, modes: Container[int], seconds: float) -> Snapshot:
    snap = link.wait_for(lambda s: s.mode is not None and s.mode in modes, seconds)
    assert snap is not None, (link.snapshot().mode, link.snapshot().health, rig.output("air"))
    return snap


def ran_m(snap: Snapshot) -> float:
    """How far the target has run."""
    return 0.0 if snap.truth is None else snap.truth.target_path_m


def told(link: GroundLink, words: str, seconds: float = 5.0) -> None:
    assert link.wait_for(lambda s: any(words in e.text for e in s.events), seconds), (
        words,
        [e.text for e in link.snapshot().events],
    )


def test_the_pilots_switch_starts_holds_goes_on_and_stops(rig: Rig, radio: Receiver, tmp_path: Path) -> None:
    config = tmp_path / "switched.toml"
    config.write_text(copied() + SWITCH)
    rig.air(vehicle=config)
    rig.spawn(
        "sim", BIN / "goshawk-sim", "serve", "--connect", rig.endpoint, "--mavlink-port", str(radio.port),
        "--seed", "3", "--distance", "80",
    )  # fmt: skip
    with rig.link() as link:
        failing = link.wait_for(
            lambda s: s.health is not None and {c.name for c in s.health.checks if not c.ok} == {"switch"}, 40.0
        )
        assert failing is not None, "without a radio nobody flies"
        radio.pulse_us = STOP
        told(link, "asked to stop")
        reach(link, rig, {pb.MODE_READY}, 10.0)
        barred = link.start()
        assert not barred.accepted and "switch stands at stop" in barred.text, barred
        radio.pulse_us = START
        told(link, "asked to start: taking off with profile chase")
        reach(link, rig, CHASING, 30.0)
        radio.pulse_us = HOLD
        told(link, "asked to hold")
        reach(link, rig, {pb.MODE_HOLD}, 5.0)
        assert link.wait_for(lambda s: s.mode != pb.MODE_HOLD, 3.0) is None, "the target runs on, it holds"
        radio.pulse_us = START
        told(link, "asked to resume: going on")
        reach(link, rig, CHASING, 5.0)
        at_m = ran_m(link.snapshot())
        assert link.wait_for(lambda s: ran_m(s) > at_m + 10.0, 60.0), "the target does not run on after a hold"
        radio.pulse_us = None
        told(link, "the pilot's radio was last heard")
        assert link.snapshot().mode in {*CHASING, pb.MODE_HOLD}, "the autopilot's own failsafe is for that"
        radio.pulse_us = STOP
        reach(link, rig, {pb.MODE_STOPPING}, 5.0)
        reach(link, rig, {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}, 30.0)
    rig.close()
    log = next(rig.logs.glob("*.mcap"))
    replayed = subprocess.run([BIN / "goshawk-air", "replay", log], capture_output=True, text=True)
    assert replayed.returncode == 0, replayed.stdout + replayed.stderr
