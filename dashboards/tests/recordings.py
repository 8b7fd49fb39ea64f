"""Writes flight logs for tests: valid MCAP of made-up motion, at the vehicle's own rates and with its own messages."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
from google.protobuf import descriptor_pb2
from google.protobuf.message import Message
from goshawk_dashboards.log.flight import CHANNELS
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from mcap.writer import CompressionType, Writer
from PIL import Image

START_NS = 5_000_000_000
CONTROL_HZ, FRAME_HZ, TRUTH_HZ = 200, 30, 20
TAKEOFF_S, LOST_S, SEARCH_S, FOUND_S = 1.0, 3.0, 4.0, 5.0
"""When the made-up flight's phases begin; it lands in its last second."""
WIDTH, HEIGHT = 160, 96
VIBRATES_HZ, VIBRATES_MPS2 = 40.0, 3.0
"""Of the IMU along the body's x, where a flight vibrates."""


def descriptor_set(kind: type[Message]) -> bytes:
    """A message's schema as MCAP wants it."""
    file = descriptor_pb2.FileDescriptorProto()
    kind.DESCRIPTOR.file.CopyToProto(file)
    return descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


class LogFile:
    """A log being written; close() ends it."""

    def __init__(self, path: Path, *, chunk_bytes: int = 1 << 20) -> None:
        self._stream = path.open("wb")
        self._writer = Writer(self._stream, chunk_size=chunk_bytes, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="tests")
        self._ids: dict[str, int] = {}

    def write(self, channel: str, time_ns: int, message: Message) -> None:
        """Adds a record."""
        if channel not in self._ids:
            topic, kind = CHANNELS[channel]
            schema = self._writer.register_schema(kind.DESCRIPTOR.full_name, "protobuf", descriptor_set(kind))
            self._ids[channel] = self._writer.register_channel(topic, "protobuf", schema)
        self._writer.add_message(self._ids[channel], time_ns, message.SerializeToString(), time_ns)

    def close(self) -> None:
        """Writes the summary."""
        self._writer.finish()
        self._stream.close()


def position(time_s: float) -> tuple[float, float, float]:
    """Where the made-up vehicle is: it weaves eastward at 4 m/s, 2 m above the ground."""
    return 4.0 * time_s, 2.0 * math.sin(time_s), 2.0


def mode_at(time_s: float, duration_s: float) -> pb.Mode:
    """The made-up flight's mode."""
    if time_s < TAKEOFF_S:
        return pb.MODE_TAKEOFF
    if time_s >= duration_s - 1.0:
        return pb.MODE_STOPPING
    return pb.MODE_SEARCH if SEARCH_S <= time_s < FOUND_S else pb.MODE_TRACK


def control(time_s: float, seq: int, duration_s: float, *, imu: bool = True) -> pb.Control:
    """A controller step; the plan expires for a moment at 6 s. ``imu``: the autopilot sends one."""
    x, y, z = position(time_s)
    expired = 6.0 <= time_s < 6.2
    return pb.Control(
        seq=seq,
        stamp_ns=START_NS + round(time_s * 1e9),
        mode=mode_at(time_s, duration_s),
        fallback=pb.FALLBACK_PLAN_EXPIRED_BRAKE if expired else pb.FALLBACK_NONE,
        pos_world=pb.Vec3(x=x, y=y, z=z),
        vel_world=pb.Vec3(x=4.0, y=2.0 * math.cos(time_s)),
        world_from_body=pb.Quat(w=1.0),
        acc_des_world=pb.Vec3(y=-2.0 * math.sin(time_s)),
        acc_att_world=pb.Vec3(),
        acc_disturbance_world=pb.Vec3(z=0.1),
        acc_meas_world=pb.Vec3(y=-2.0 * math.sin(time_s)) if imu else None,
        world_from_body_des=pb.Quat(w=1.0),
        thrust_n=8.3,
        thrust_norm=0.25,
        hover_thrust=0.262,
        attitude_lag_s=0.071,
    )


def plan(time_s: float, seq: int, chosen: int = 7) -> pb.Plan:
    """15 candidates fanned out ahead, the one in the middle chosen."""
    x, y, z = position(time_s)
    stamp_ns = START_NS + round(time_s * 1e9)
    message = pb.Plan(
        seq=seq,
        frame_ns=stamp_ns,
        ready_ns=stamp_ns,
        start_pos_world=pb.Vec3(x=x, y=y, z=z),
        start_vel_world=pb.Vec3(x=4.0),
        start_acc_world=pb.Vec3(),
        world_from_cam=pb.Quat(w=1.0),
        duration_s=1.5,
        alpha=0.7,
        chosen=chosen,
    )
    for k in range(15):
        azimuth, up = 0.7 - 0.35 * (k % 5), 1.0 - k // 5
        message.candidates.add(
            end_pos_world=pb.Vec3f(x=x + 5 * math.cos(azimuth), y=y + 5 * math.sin(azimuth), z=z + up),
            end_vel_world=pb.Vec3f(x=3.0),
            end_acc_world=pb.Vec3f(),
            cost=1.0 + 0.1 * abs(k - chosen),
            added_obstacle=0.25 if k == chosen + 1 else 0.0,
            objectness=0.9 if k == chosen else 0.1,
            target_pos_world=pb.Vec3f(x=x + 6.0, y=y, z=0.95),
            rejection=pb.REJECTION_NONE if k == chosen else pb.REJECTION_COST,
        )
    return message


def remembered(time_s: float, seq: int) -> pb.ObstacleMap:
    """A wall of 2 m 4 m ahead."""
    x, y, z = position(time_s)
    return pb.ObstacleMap(
        seq=seq,
        stamp_ns=START_NS + round(time_s * 1e9),
        origin_world=pb.Vec3(x=x + 4.0, y=y - 1.0, z=z - 1.0),
        voxel_m=0.2,
        voxels=bytes(n for row in range(10) for up in range(10) for n in (0, row, up)),
        depth=depth(time_s),
    )


def depth(time_s: float) -> pb.DepthBlocks:
    """One block to the right of and below the middle sees something 5 m ahead, all others nothing."""
    x, y, z = position(time_s)
    nearest_dm = bytearray(24 * 40)
    nearest_dm[12 * 40 + 20] = 50
    return pb.DepthBlocks(
        frame_ns=START_NS + round(time_s * 1e9),
        cam_world=pb.Vec3(x=x, y=y, z=z),
        world_from_cam=pb.Quat(w=1.0),
        hfov_rad=math.pi / 2,
        vfov_rad=math.pi / 3,
        nearest_dm=bytes(nearest_dm),
    )


def target(time_s: float, seq: int, seen: bool) -> pb.Target:
    """The target, 6 m ahead; out of sight since LOST_S where it is not seen."""
    x, y, _ = position(time_s)
    return pb.Target(
        seq=seq,
        stamp_ns=START_NS + round(time_s * 1e9),
        pos_world=pb.Vec3(x=x + 6.0, y=y, z=0.95),
        vel_world=pb.Vec3(x=4.0),
        covariance_upper=np.diag([0.04, 0.04, 0.04, 1.0, 1.0, 1.0])[np.triu_indices(6)].tolist(),
        confirmed=True,
        since_seen_s=0.0 if seen else time_s - LOST_S,
    )


def truth(time_s: float, collisions: int = 0) -> pb.SimTruth:
    """What the simulator knows."""
    x, y, z = position(time_s)
    return pb.SimTruth(
        stamp_ns=START_NS + round(time_s * 1e9),
        pos_world=pb.Vec3(x=x, y=y, z=z),
        world_from_body=pb.Quat(w=1.0),
        vel_world=pb.Vec3(x=4.0),
        acc_world=pb.Vec3(y=-2.0 * math.sin(time_s), z=0.05),
        target_pos_world=pb.Vec3(x=x + 6.1, y=y, z=0.95),
        target_vel_world=pb.Vec3(x=4.0),
        collisions=collisions,
        clearance_m=1.0 + 0.8 * math.cos(time_s),
        target_distance_m=6.1,
        target_visible=True,
    )


def frame(time_s: float, seq: int, noise: np.random.Generator) -> pb.CompressedRgbd:
    """A picture as large, compressed, as one of a forest (about 20 kB with its depth), and a wall 4 m ahead."""
    rgb = noise.integers(40, 150, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    depth = np.full((HEIGHT, WIDTH), 4000, dtype=np.uint16) + noise.integers(0, 48, (HEIGHT, WIDTH), dtype=np.uint16)
    colour, png = io.BytesIO(), io.BytesIO()
    Image.fromarray(rgb).save(colour, "PNG", compress_level=1)
    Image.fromarray(depth).save(png, "PNG", compress_level=1)
    return pb.CompressedRgbd(
        seq=seq,
        stamp_ns=START_NS + round(time_s * 1e9),
        width=WIDTH,
        height=HEIGHT,
        hfov_rad=math.pi / 2,
        vfov_rad=2 * math.atan(HEIGHT / WIDTH),
        rgb_png=colour.getvalue(),
        depth_png=png.getvalue(),
    )


def write_flight(
    path: Path,
    duration_s: float = 8.0,
    *,
    chosen: int = 7,
    chunk_bytes: int = 1 << 20,
    told: str = "",
    collides_s: float = math.inf,
    imu_until_s: float = math.inf,
    vibrates: bool = False,
) -> Path:
    """A whole flight. A few pictures are made and used again, so that a long log is written in bearable time.

    ``told`` is what the vehicle says as its take-off ends; from ``collides_s`` on the simulator counts a collision;
    after ``imu_until_s`` the autopilot sends no IMU any more; ``vibrates``: its IMU is logged, and it shakes.
    """
    log = LogFile(path, chunk_bytes=chunk_bytes)
    noise = np.random.default_rng(1)
    pictures = [frame(0.0, k, noise) for k in range(96)]
    log.write(
        "header",
        START_NS,
        pb.LogHeader(protocol=PROTOCOL, vehicle="kite", profile="chase", wall_time="2026-01-01T00:00:00.000Z"),
    )
    takeoff = pb.Event(stamp_ns=START_NS + 10, severity=pb.SEVERITY_INFO, kind="command", text="start accepted")
    log.write("event", takeoff.stamp_ns, takeoff)
    if told:
        stamp_ns = START_NS + round(TAKEOFF_S * 1e9)
        log.write("event", stamp_ns, pb.Event(stamp_ns=stamp_ns, severity=pb.SEVERITY_INFO, kind="mode", text=told))
    for step in range(round(duration_s * CONTROL_HZ)):
        time_s = step / CONTROL_HZ
        stamp_ns = START_NS + round(time_s * 1e9)
        log.write("control", stamp_ns, control(time_s, step, duration_s, imu=time_s < imu_until_s))
        if vibrates:
            shaken = VIBRATES_MPS2 * math.sin(2.0 * math.pi * VIBRATES_HZ * time_s)
            log.write("imu", stamp_ns, pb.Imu(stamp_ns=stamp_ns, specific_force_body=pb.Vec3(x=shaken, z=9.81)))
        if step % CONTROL_HZ == 0:
            log.write("map", stamp_ns, remembered(time_s, step // CONTROL_HZ))
        if step % (CONTROL_HZ // TRUTH_HZ) == 0:
            log.write("sim_truth", stamp_ns, truth(time_s, int(time_s >= collides_s)))
        seq = step * FRAME_HZ // CONTROL_HZ
        if step == 0 or seq != (step - 1) * FRAME_HZ // CONTROL_HZ:
            picture = pictures[seq % len(pictures)]
            picture.seq, picture.stamp_ns = seq, stamp_ns
            log.write("rgbd", stamp_ns, picture)
            log.write("plan", stamp_ns, plan(time_s, seq, chosen))
            if not SEARCH_S <= time_s < FOUND_S:
                log.write("target", stamp_ns, target(time_s, seq, not LOST_S <= time_s < FOUND_S))
    log.close()
    return path


def write_replay(path: Path, duration_s: float, *, chosen: int, later_s: float = 0.0) -> Path:
    """What another policy made of the frames of ``write_flight``: header and plans; ``later_s`` makes it a stranger."""
    log = LogFile(path)
    log.write("header", START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite", policy_sha256="other"))
    for step in range(round(duration_s * CONTROL_HZ)):
        if step == 0 or step * FRAME_HZ // CONTROL_HZ != (step - 1) * FRAME_HZ // CONTROL_HZ:
            time_s = step / CONTROL_HZ + later_s
            log.write("plan", START_NS + round(time_s * 1e9), plan(time_s, step * FRAME_HZ // CONTROL_HZ, chosen))
    log.close()
    return path
