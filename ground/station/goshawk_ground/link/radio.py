"""The autopilot over its own telemetry radio, beside the vehicle's link: listened to, never spoken to.

pymavlink reads the bytes; the connection's ``write`` is replaced by one that raises, so that nothing, not even a
heartbeat, can leave by it, whatever pymavlink does by itself.
"""

from __future__ import annotations

import re
import threading
import time
from collections import deque
from typing import Any, Self

from goshawk_dashboards.state.views import AutopilotView
from goshawk_proto import goshawk_pb2 as pb

from goshawk_ground.link.dial import LinkError

TEXTS = 8
WINDOW_S = 5.0
RETRY_S = 1.0
_SOURCE = re.compile(r"(udpin|tcp|tcpin):[^:\s]+:\d{1,5}|/dev/\S+?(,\d+)?")
_AUTOPILOT = 1
"""MAV_COMP_ID_AUTOPILOT1: who else speaks on the radio, a ground station or a camera, is no autopilot."""
_ERROR, _WARNING = 3, 4
"""MAV_SEVERITY."""


class AutopilotState:
    """What the messages say so far. Pure: the time is an argument, seconds of one monotonic clock."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._heartbeat_s: float | None = None
        self._mode = ""
        self._armed = self._failsafe = False
        self._battery_fraction: float | None = None
        self._battery_v: float | None = None
        self._rssi: tuple[int, int] | None = None
        self._texts: deque[tuple[pb.Severity, str]] = deque(maxlen=TEXTS)
        self._arrivals: deque[tuple[float, int]] = deque(maxlen=2048)
        self._seq = 0

    def take(self, message: Any, mode: str, now_s: float) -> None:
        """One message; ``mode`` is what pymavlink calls the mode of a heartbeat."""
        kind = message.get_type()
        if kind == "RADIO_STATUS":
            self._rssi = (message.rssi, message.remrssi)
        if message.get_srcComponent() != _AUTOPILOT or kind == "BAD_DATA":
            return
        self._count(message.get_seq(), now_s)
        if kind == "HEARTBEAT":
            self._heartbeat_s, self._mode = now_s, mode
            self._armed = bool(message.base_mode & 128)
            self._failsafe = message.system_status in (5, 6)  # MAV_STATE_CRITICAL, MAV_STATE_EMERGENCY
        elif kind == "SYS_STATUS":
            self._battery_fraction = 0.01 * message.battery_remaining if message.battery_remaining >= 0 else None
            self._battery_v = 1e-3 * message.voltage_battery if message.voltage_battery < 0xFFFF else None
        elif kind == "STATUSTEXT":
            self._texts.append((_severity(message.severity), str(message.text).strip("\0 ")))

    def _count(self, seq: int, now_s: float) -> None:
        """Notes an arrival with how many messages it ends: itself, and those lost before it."""
        before = self._arrivals[-1][0] if self._arrivals else None
        lost = (seq - self._seq - 1) % 256 if before is not None else 0
        self._seq = seq
        # After a long silence, or a restart, the gap says nothing: the number has gone round since.
        self._arrivals.append((now_s, 1 + lost if before is not None and now_s - before < 2.0 and lost < 128 else 1))

    def view(self, now_s: float, trouble: str = "") -> AutopilotView:
        """All that is known now."""
        while self._arrivals and now_s - self._arrivals[0][0] > WINDOW_S:
            self._arrivals.popleft()
        sent = sum(ended for _, ended in self._arrivals)
        return AutopilotView(
            source=self._source,
            age_s=None if self._heartbeat_s is None else max(0.0, now_s - self._heartbeat_s),
            mode=self._mode,
            armed=self._armed,
            battery_fraction=self._battery_fraction,
            battery_v=self._battery_v,
            loss_fraction=1.0 - len(self._arrivals) / sent if len(self._arrivals) > 10 else None,
            radio_rssi=self._rssi,
            rate_hz=len(self._arrivals) / WINDOW_S,
            failsafe=self._failsafe,
            texts=tuple(self._texts),
            trouble=trouble,
        )


class Radio:
    """Listens to one autopilot from a thread of its own."""

    def __init__(self, source: str) -> None:
        """``source`` as pymavlink writes it. Raises LinkError if it cannot be one, or its port cannot be had."""
        if not _SOURCE.fullmatch(source):
            raise LinkError(f"'{source}' is not a source such as udpin:0.0.0.0:14550 or /dev/ttyUSB0,57600")
        self._source = source
        self._lock = threading.Lock()
        self._state = AutopilotState(source)
        self._trouble = ""
        self._closing = threading.Event()
        self._connection: Any = self._open() if source.startswith("udpin") else None
        self._thread = threading.Thread(target=self._run, name="radio", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stops listening; safe to call twice."""
        self._closing.set()
        self._thread.join(timeout=3.0)

    def view(self) -> AutopilotView:
        """All that is known now."""
        with self._lock:
            return self._state.view(time.monotonic(), self._trouble)

    def _open(self) -> Any:
        device, _, baud = self._source.partition(",")
        try:
            connection = _mavutil().mavlink_connection(device, baud=int(baud or 57600))
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or error
            raise LinkError(f"cannot listen on {self._source}: {why}") from error
        connection.write = _refuse
        return connection

    def _run(self) -> None:
        mode_of = _mavutil().mode_string_v10
        while not self._closing.is_set():
            try:
                if self._connection is None:
                    self._connection = self._open()
                message = self._connection.recv_match(blocking=True, timeout=0.2)
            except Exception as error:  # whatever pymavlink raises of a source: the operator must see that it is deaf
                self._give_up(" ".join(str(error).split()))
                continue
            if message is None:
                continue
            mode = mode_of(message) if message.get_type() == "HEARTBEAT" else ""
            with self._lock:
                self._trouble = ""
                self._state.take(message, mode, time.monotonic())
        if self._connection is not None:
            self._connection.close()

    def _give_up(self, why: str) -> None:
        with self._lock:
            self._trouble = why
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        self._closing.wait(RETRY_S)


def _mavutil() -> Any:
    """pymavlink's, which has no types; a second to import, so only where a radio is configured."""
    from pymavlink import mavutil

    return mavutil


def _severity(mavlink: int) -> pb.Severity:
    if mavlink <= _ERROR:
        return pb.SEVERITY_ERROR
    return pb.SEVERITY_WARNING if mavlink == _WARNING else pb.SEVERITY_INFO


def _refuse(*_: object) -> None:
    raise PermissionError("the autopilot's radio is only listened to")
