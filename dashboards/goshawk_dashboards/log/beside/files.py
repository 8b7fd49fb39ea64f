"""The autopilot's own logs, PX4's ULog and a ground station's tlog, as signals by their own clock.

Shape suffixes: M samples, 3 a vector, 4 a quaternion (w, x, y, z).
"""

from __future__ import annotations

import contextlib
import io
import struct
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from goshawk_dashboards.log.beside.motion import Motion, Series
from goshawk_dashboards.state.views import Array

ULOG_BEGINS = b"ULog\x01\x12\x35"
MAVLINK_BEGINS = (0xFD, 0xFE)
"""A packet's first byte, MAVLink 2 and 1: in a tlog it comes after eight bytes of time."""
RESTARTED_S = 1.0
"""A sender's clock that steps back by more was started anew; by less, packets came out of turn."""


class BesideError(ValueError):
    """The file cannot be laid beside a flight; one line that names it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Told:
    """What a log tells, by its own clock."""

    signals: Mapping[str, Series]
    """By message and field, such as "vehicle_attitude.q[0]"."""
    motion: Motion
    flaw: str
    """What is wrong with the file; empty: nothing."""


def read(path: Path) -> Told:
    """Raises BesideError for what is no such log, or holds no attitude and no velocity."""
    try:
        with path.open("rb") as stream:
            head = stream.read(16)
    except OSError as error:
        raise BesideError(f"cannot read {path}: {error.strerror}") from error
    if head.startswith(ULOG_BEGINS):
        return _read_ulog(path)
    if len(head) > 8 and head[8] in MAVLINK_BEGINS:
        return _read_tlog(path)
    raise BesideError(f"{path} is neither a ULog nor a tlog")


def _read_ulog(path: Path) -> Told:
    from pyulog import ULog  # only where one is asked for
    from pyulog.core import ULogException

    try:
        with contextlib.redirect_stdout(io.StringIO()):  # it prints what it thinks of the file
            log: Any = ULog(str(path))
    except (ULogException, OSError, ValueError, KeyError, IndexError, TypeError, struct.error) as error:
        raise BesideError(f"{path} is a damaged ULog: {_line(error)}") from error
    timed = [data for data in log.data_list if "timestamp" in data.data]
    damaged = log.file_corruption or len(timed) < len(log.data_list)
    several = {data.name for data in timed if data.multi_id > 0}
    signals: dict[str, Series] = {}
    for data in timed:
        name = f"{data.name}#{data.multi_id}" if data.name in several else data.name
        times_s = data.data["timestamp"].astype(np.float64) * 1e-6
        for field, values in data.data.items():
            if field != "timestamp" and "_padding" not in field:
                signals[f"{name}.{field}"] = (times_s, values)
    first = {name: f"{name}#0" if name in several else name for name in ("vehicle_attitude", "vehicle_local_position")}
    motion = _motion(
        path,
        signals,
        [f"{first['vehicle_attitude']}.q[{k}]" for k in range(4)],
        [f"{first['vehicle_local_position']}.v{axis}" for axis in "xyz"],
    )
    return Told(signals=signals, motion=motion, flaw="damaged: what is whole is shown" if damaged else "")


def _read_tlog(path: Path) -> Told:
    from pymavlink import mavutil

    rows: defaultdict[tuple[tuple[int, int], str], list[Any]] = defaultdict(list)
    bad = 0
    try:
        log: Any = mavutil.mavlogfile(str(path), notimestamps=False)
        while (message := log.recv_msg()) is not None:
            kind = message.get_type()
            if kind == "BAD_DATA":
                bad += 1
            elif not kind.startswith("UNKNOWN"):
                rows[(message.get_srcSystem(), message.get_srcComponent()), kind].append(message)
        log.close()
    except (OSError, ValueError, struct.error) as error:
        raise BesideError(f"{path} is a damaged tlog: {_line(error)}") from error
    attitudes = {sender: len(some) for (sender, kind), some in rows.items() if kind.startswith("ATTITUDE")}
    if not attitudes:
        raise BesideError(f"{path} holds no attitude")
    autopilot = max(attitudes, key=lambda sender: attitudes[sender])
    begin_s = min(some[0]._timestamp for some in rows.values())
    signals: dict[str, Series] = {}
    for (sender, kind), some in rows.items():
        name = kind if sender == autopilot else f"{kind}@{sender[0]}.{sender[1]}"
        times_s = _times_s(some, begin_s)
        for field in some[0].get_fieldnames():
            values = [getattr(message, field) for message in some]
            if isinstance(values[0], list):
                for k, column in enumerate(zip(*values, strict=True)):
                    signals[f"{name}.{field}[{k}]"] = (times_s, np.array(column))
            elif isinstance(values[0], (int, float)):
                signals[f"{name}.{field}"] = (times_s, np.array(values, dtype=np.float64))
    if "ATTITUDE_QUATERNION.q1" in signals:
        attitude = [f"ATTITUDE_QUATERNION.q{k}" for k in range(1, 5)]
    else:
        attitude = [f"ATTITUDE.{angle}" for angle in ("roll", "pitch")]
    flaw = f"{bad} stretches of it are no MAVLink" if bad else ""
    velocity = [f"LOCAL_POSITION_NED.v{axis}" for axis in "xyz"]
    return Told(signals=signals, motion=_motion(path, signals, attitude, velocity), flaw=flaw)


def _times_s(some: Sequence[Any], begin_s: float) -> Array:
    """When messages of one kind were sent, since the log's begin.

    A radio bunches what it carries: the sender's own clock tells better, laid where the messages arrived. A sender
    that was started anew counts anew: each stretch is laid by itself.
    """
    arrived_s = np.array([message._timestamp for message in some]) - begin_s
    for field, unit_s in (("time_boot_ms", 1e-3), ("time_usec", 1e-6)):
        if field in some[0].get_fieldnames():
            sent_s = unit_s * np.array([getattr(message, field) for message in some], dtype=np.float64)
            starts = np.flatnonzero(np.diff(sent_s) < -RESTARTED_S) + 1
            stretches = zip(np.split(sent_s, starts), np.split(arrived_s, starts), strict=True)
            return np.concatenate([sent + np.median(arrived - sent) for sent, arrived in stretches])
    return arrived_s


def _motion(path: Path, signals: Mapping[str, Series], attitude: list[str], velocity: list[str]) -> Motion:
    lacking = [name for name in (*attitude, *velocity) if name not in signals]
    if lacking:
        raise BesideError(f"{path} holds no {lacking[0]}: no clock can be fitted")
    times_s = signals[attitude[0]][0]
    parts = [signals[name][1].astype(np.float64) for name in attitude]
    q_M4 = np.stack(parts, axis=1) if len(parts) == 4 else _level_M4(*parts)
    speeds_M3 = np.stack([signals[name][1].astype(np.float64) for name in velocity], axis=1)
    return Motion.of((times_s, q_M4), (signals[velocity[0]][0], speeds_M3))


def _level_M4(roll_M: Array, pitch_M: Array) -> Array:
    """The attitude without its yaw, which no tilt depends on."""
    roll, pitch = 0.5 * roll_M, 0.5 * pitch_M
    parts = (np.cos(roll) * np.cos(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.sin(pitch))
    return np.stack([*parts, -np.sin(roll) * np.sin(pitch)], axis=1)


def _line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
