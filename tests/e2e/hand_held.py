"""A vehicle in a person's hands: a PX4, made of pymavlink, that tells where it is held, to whoever listens."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common as mavlink
from scipy.spatial.transform import Rotation

GRAVITY = 9.81
MOVE_S = 0.8
EVERYBODY = 0x81  # a heartbeat's base mode: custom mode, disarmed


class HandHeld:
    """It lies level, a metre up, looking north, until it is moved. Its autopilot is mounted by ``board``, its camera by
    ``hung``: the one turns what it tells the vehicle, the other what it tells the simulator."""

    rates_sign = 1.0

    def __init__(self, air: int, world: int, *, board: Rotation | None = None, hung: Rotation | None = None) -> None:
        none = Rotation.identity()
        self.ports = [(air, board or none), (world, hung or none)]
        self.sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in self.ports]
        for one, (port, _) in zip(self.sockets, self.ports, strict=True):
            one.connect(("127.0.0.1", port))
            one.setblocking(False)
        self.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.begun = time.monotonic()
        here = (np.array([0.0, 0.0, -1.0]), none)
        self.way = (here, here, -MOVE_S)
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def close(self) -> None:
        self.ended.set()
        self.thread.join()

    def now(self) -> float:
        """Since it began, s."""
        return time.monotonic() - self.begun

    def move(self, ned_m: NDArray[np.float64], ned_from_frd: Rotation) -> None:
        """Moves it there from where it is, within MOVE_S, and waits until it is there."""
        self.way = (self._pose(self.now()), (ned_m, ned_from_frd), self.now())
        time.sleep(MOVE_S)

    def _pose(self, now: float) -> tuple[NDArray[np.float64], Rotation]:
        (from_m, from_turn), (to_m, to_turn), begun = self.way
        part = min(max((now - begun) / MOVE_S, 0.0), 1.0)
        part = part * part * (3.0 - 2.0 * part)
        turn = (from_turn.inv() * to_turn).as_rotvec() * part
        return from_m + part * (to_m - from_m), from_turn * Rotation.from_rotvec(turn)

    def _run(self) -> None:
        ticks = 0
        while not self.ended.is_set():
            now = self.now()
            if now * 50 < ticks:
                time.sleep(0.002)
                continue
            for one, (_, mounted) in zip(self.sockets, self.ports, strict=True):
                self._answer(one)
                for message in self._messages(now, mounted, ticks):
                    self._send(one, message)
            ticks += 1

    def _messages(self, now: float, mounted: Rotation, ticks: int) -> list[Any]:
        (north, east, below), turn = self._pose(now)
        (before_m, before), (after_m, after) = self._pose(now - 0.01), self._pose(now + 0.01)
        velocity = (after_m - before_m) / 0.02
        rolls, pitches, yaws = self.rates_sign * mounted.inv().apply((before.inv() * after).as_rotvec() / 0.02)
        turn = turn * mounted
        x, y, z, w = turn.as_quat()
        ahead, right, down = turn.inv().apply(velocity)
        force = turn.inv().apply([0.0, 0.0, -GRAVITY])
        stamp = int(now * 1e6)
        imu: list[Any] = [stamp, *force, *[0.0] * 10, 63]
        messages: list[Any] = [
            mavlink.MAVLink_odometry_message(
                stamp, mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD, north, east, below, [w, x, y, z],
                ahead, right, down, rolls, pitches, yaws, [0.01] * 21, [0.01] * 21, 0, 8, 100,
            ),
            mavlink.MAVLink_highres_imu_message(*imu),
        ]  # fmt: skip
        if ticks % 25 == 0:
            messages.append(mavlink.MAVLink_heartbeat_message(2, 12, EVERYBODY & ~0x80, 0, 3, 3))
        return messages

    def _answer(self, one: socket.socket) -> None:
        """Its clock, to whoever asks."""
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            messages: list[Any] = mavlink.MAVLink(None).parse_buffer(one.recv(2048)) or []
            for message in messages:
                if message.get_type() == "TIMESYNC" and message.tc1 == 0:
                    self._send(one, mavlink.MAVLink_timesync_message(int(self.now() * 1e9), message.ts1))

    def _send(self, one: socket.socket, message: Any) -> None:
        with contextlib.suppress(ConnectionRefusedError, BlockingIOError):
            one.send(message.pack(self.mav))
