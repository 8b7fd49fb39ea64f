"""The autopilot's own logs of a made-up flight, written by rules of their own, and that flight's log.

Shape suffixes: M samples, 3 a vector, 4 a quaternion (w, x, y, z).
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import recordings as rec
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from numpy.typing import NDArray
from pymavlink.dialects.v20 import common

RATE_HZ = 50.0
Array = NDArray[np.float64]


class Flown:
    """How it swayed: tilts and speeds that do not repeat themselves, in ENU and FLU."""

    def __init__(self, duration_s: float, seed: int) -> None:
        random = np.random.default_rng(seed)
        self.hz_K, self.phase_K = random.uniform(0.05, 0.9, 9), random.uniform(0.0, 2.0 * np.pi, 9)
        self.times_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)

    def _sum(self, times_s: Array, first: int) -> Array:
        some = slice(first, first + 3)
        return np.sin(2.0 * np.pi * np.outer(times_s, self.hz_K[some]) + self.phase_K[some]).sum(axis=1)

    def attitude_M4(self, times_s: Array) -> Array:
        """Roll alone, up to 0.3 rad."""
        half_M = 0.05 * self._sum(times_s, 0)
        return np.stack([np.cos(half_M), np.sin(half_M), 0.0 * half_M, 0.0 * half_M], axis=1)

    def velocity_M3(self, times_s: Array) -> Array:
        """East and north, m/s."""
        return np.stack([3.0 + self._sum(times_s, 3), self._sum(times_s, 6), 0.0 * times_s], axis=1)


def write_flown(path: Path, flown: Flown) -> Path:
    """Our log of it: header and odometry."""
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite"))
    attitudes, velocities = flown.attitude_M4(flown.times_s), flown.velocity_M3(flown.times_s)
    for k, time_s in enumerate(flown.times_s):
        stamp_ns = rec.START_NS + round(time_s * 1e9)
        (w, x, y, z), (vx, vy, vz) = attitudes[k], velocities[k]
        odometry = pb.Odometry(
            seq=k,
            stamp_ns=stamp_ns,
            pos_world=pb.Vec3(),
            vel_world=pb.Vec3(x=vx, y=vy, z=vz),
            world_from_body=pb.Quat(w=w, x=x, y=y, z=z),
            ang_vel_body=pb.Vec3(),
        )
        log.write("odometry", stamp_ns, odometry)
        control = rec.control(time_s, k, float(flown.times_s[-1]))
        control.vel_world.CopyFrom(odometry.vel_world)
        control.world_from_body.CopyFrom(odometry.world_from_body)
        log.write("control", stamp_ns, control)
    log.close()
    return path


def _theirs(flown: Flown, begin_s: float, drift: float) -> tuple[Array, Array, Array]:
    """Their clock, and attitude (NED, FRD: the same roll) and velocity (NED)."""
    times_s = flown.times_s[50:-50] + 0.007
    velocity_M3 = flown.velocity_M3(times_s)[:, [1, 0, 2]] * (1.0, 1.0, -1.0)
    return begin_s + times_s / (1.0 + drift), flown.attitude_M4(times_s), velocity_M3


def write_ulog(path: Path, flown: Flown, begin_s: float, drift: float) -> Path:
    """A ULog as PX4 writes it: header, flags, formats, subscriptions, data."""
    formats = (
        b"vehicle_attitude:uint64_t timestamp;float[4] q;",
        b"vehicle_local_position:uint64_t timestamp;float vx;float vy;float vz;",
        b"battery_status:uint64_t timestamp;float voltage_v;",
    )

    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<Hc", len(body), kind) + body

    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0), message(b"B", bytes(40))]
    parts += [message(b"F", text) for text in formats]
    parts += [message(b"A", struct.pack("<BH", 0, k) + text.split(b":")[0]) for k, text in enumerate(formats)]
    for k, (time_s, attitude_4, velocity_3) in enumerate(zip(*_theirs(flown, begin_s, drift), strict=True)):
        stamp_us = round(time_s * 1e6)
        parts.append(message(b"D", struct.pack("<HQ4f", 0, stamp_us, *attitude_4)))
        parts.append(message(b"D", struct.pack("<HQ3f", 1, stamp_us, *velocity_3)))
        if k % 50 == 0:
            parts.append(message(b"D", struct.pack("<HQf", 2, stamp_us, 16.8 - 0.01 * k)))
    path.write_bytes(b"".join(parts))
    return path


def write_tlog(path: Path, flown: Flown, begin_s: float, drift: float, *, unix_s: float = 1.79e9) -> Path:
    """A ground station's tlog: it carries the autopilot's clock, and when each packet came, up to 0.3 s late."""
    late = np.random.default_rng(5).uniform(0.0, 0.3, len(flown.times_s))
    sender = common.MAVLink(None, srcSystem=1, srcComponent=1)
    parts: list[bytes] = []
    for k, (time_s, (w, x, y, z), (north, east, down)) in enumerate(zip(*_theirs(flown, begin_s, drift), strict=True)):
        came = struct.pack(">Q", round((unix_s + time_s - begin_s + late[k]) * 1e6))
        boot_ms = round(time_s * 1e3)
        packets = (
            sender.attitude_quaternion_encode(boot_ms, w, x, y, z, 0.0, 0.0, 0.0),
            sender.local_position_ned_encode(boot_ms, 0.0, 0.0, 0.0, north, east, down),
        )
        parts += [came + packet.pack(sender) for packet in packets]
    path.write_bytes(b"".join(parts))
    return path
