"""A vehicle for tests: a real Zenoh session with made-up motion.

It listens, publishes every telemetry channel of the key table at its usual rate, answers start and stop as the
vehicle does (refused unless ready, a repeated id gets its first answer again), and stands in for the simulator's
`sim/truth` and `sim/world`. Flags make it misbehave. It prints `listening` once it does.

    python fake_vehicle.py --listen tcp/127.0.0.1:17447 --lose 0.2
"""

from __future__ import annotations

import argparse
import io
import json
import math
import random
import signal
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from goshawk_proto import KEYS, PROTOCOL, key_expression
from goshawk_proto import goshawk_pb2 as pb
from PIL import Image, ImageDraw

HFOV_RAD = math.pi / 2
VFOV_RAD = 2 * math.atan(48 / 80)
TAKEOFF_S = 2.0
LANDING_S = 2.0
UNKNOWN = b"\xfa\x3f\x03new" + b"\xf0\x3f\x2a"
"""Fields 1023 and 1022 of a message that has grown: text and a number."""


def target_at(path_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Position (centre) and unit heading of a target that weaves eastward."""
    x = 6.0 + path_m
    y = 2.5 * math.sin(path_m / 6.0)
    heading = np.array([1.0, 2.5 / 6.0 * math.cos(path_m / 6.0), 0.0])
    return np.array([x, y, 0.95]), heading / np.linalg.norm(heading)


def wxyz(yaw: float, pitch_down: float = 0.0) -> pb.Quat:
    """Yaw about z, then pitch about the new y."""
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch_down / 2), math.sin(pitch_down / 2)
    return pb.Quat(w=cy * cp, x=-sy * sp, y=cy * sp, z=sy * cp)


def vec(v: np.ndarray) -> pb.Vec3:
    """A double vector."""
    return pb.Vec3(x=float(v[0]), y=float(v[1]), z=float(v[2]))


def vecf(v: np.ndarray) -> pb.Vec3f:
    """A single-precision vector."""
    return pb.Vec3f(x=float(v[0]), y=float(v[1]), z=float(v[2]))


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Where everything is at one instant."""

    pos: np.ndarray
    vel: np.ndarray
    acc: np.ndarray
    yaw: float
    target_pos: np.ndarray
    target_vel: np.ndarray
    path_m: float


class FakeVehicle:
    """The state machine and the messages."""

    def __init__(self, args: argparse.Namespace) -> None:
        self.args = args
        self.lock = threading.Lock()
        self.mode: pb.Mode = pb.MODE_IDLE
        self.since_s = 0.0
        self.flown_s = 0.0
        self.answers: dict[str, pb.CommandReply] = {}
        self.rng = random.Random(args.seed)
        self.np_rng = np.random.default_rng(args.seed)
        self.trees = self.world().trees

    def step(self, now_s: float, dt_s: float) -> str | None:
        """Moves on in time; the text of the event if the mode changed."""
        with self.lock:
            held_s = now_s - self.since_s
            if self.mode in (pb.MODE_TRACK, pb.MODE_STOPPING):
                self.flown_s += dt_s
            following = {
                pb.MODE_IDLE: (pb.MODE_READY, 0.5 if not self.args.not_ready else math.inf),
                pb.MODE_TAKEOFF: (pb.MODE_TRACK, TAKEOFF_S),
                pb.MODE_STOPPING: (pb.MODE_LANDED, LANDING_S),
            }.get(self.mode)
            if following is None or held_s < following[1]:
                return None
            self.mode, self.since_s = following[0], now_s
            return f"mode: {pb.Mode.Name(self.mode).removeprefix('MODE_').lower()}"

    def command(self, verb: str, command_id: str, profile: str, now_s: float) -> pb.CommandReply:
        """Answers start or stop."""
        with self.lock:
            if command_id in self.answers:
                return self.answers[command_id]
            flying = self.mode in (pb.MODE_TAKEOFF, pb.MODE_TRACK)
            accepted, reason = True, "taking off"
            if verb == "start" and self.mode not in (pb.MODE_READY, pb.MODE_LANDED):
                accepted, reason = False, "already flying" if flying else "not ready: odometry: no odometry yet"
            elif verb == "start" and profile not in ("", "normal", "fast"):
                accepted, reason = False, f"no profile named '{profile}': normal, fast"
            elif verb == "start":
                self.mode, self.since_s, self.flown_s = pb.MODE_TAKEOFF, now_s, 0.0
            elif flying:
                self.mode, self.since_s, reason = pb.MODE_STOPPING, now_s, "braking, then landing"
            else:
                reason = "not flying"
            reply = pb.CommandReply(command_id=command_id, accepted=accepted, reason=reason, mode=self.mode)
            self.answers[command_id] = reply
            if self.args.acted:
                with self.args.acted.open("a", encoding="utf-8") as file:
                    file.write(f"{verb} {command_id}\n")
            return reply

    def motion(self, now_s: float) -> Motion:
        """The pose follows the target 5 m behind, at 1.6 m, and stands on the ground before and after."""
        held_s = now_s - self.since_s
        height = {
            pb.MODE_TAKEOFF: 1.6 * min(1.0, held_s / TAKEOFF_S),
            pb.MODE_TRACK: 1.6,
            pb.MODE_STOPPING: 1.6 * max(0.0, 1.0 - held_s / LANDING_S),
        }.get(self.mode, 0.0)
        moving = self.mode in (pb.MODE_TRACK, pb.MODE_STOPPING)
        path_m = self.args.speed * self.flown_s
        target, heading = target_at(path_m)
        behind, along = target_at(path_m - 5.0)
        behind = behind + np.array([0.0, 0.3 * math.sin(now_s), 0.0])
        pos = np.array([behind[0], behind[1], 0.05 + height])
        speed = self.args.speed if moving else 0.0
        to_target = target - pos
        return Motion(
            pos=pos,
            vel=along * speed + np.array([0.0, 0.3 * math.cos(now_s) if moving else 0.0, 0.0]),
            acc=np.array([0.3 * math.sin(2 * now_s), 1.2 * math.sin(1.3 * now_s), 0.4 * math.sin(now_s)])
            * float(moving),
            yaw=math.atan2(to_target[1], to_target[0]),
            target_pos=target,
            target_vel=heading * (self.args.speed if self.mode == pb.MODE_TRACK else 0.0),
            path_m=path_m,
        )

    def plan(self, m: Motion, seq: int, stamp_ns: int) -> pb.Plan:
        """15 candidates on the lattice; the one nearest the target's direction is flown."""
        duration = 2 * 5.0 / 6.0
        plan = pb.Plan(
            seq=seq,
            frame_ns=stamp_ns,
            ready_ns=stamp_ns + 3_000_000,
            start_pos_world=vec(m.pos),
            start_vel_world=vec(m.vel),
            start_acc_world=vec(m.acc),
            world_from_cam=wxyz(m.yaw),
            duration_s=duration,
            alpha=1.0,
        )
        best, best_off = 0, math.inf
        for row in range(3):
            for col in range(5):
                azimuth = m.yaw + HFOV_RAD * (0.5 - (col + 0.5) / 5) + 0.08 * math.sin(stamp_ns * 1e-9 + col)
                elevation = VFOV_RAD * (0.5 - (row + 0.5) / 3)
                out = np.array(
                    [
                        math.cos(elevation) * math.cos(azimuth),
                        math.cos(elevation) * math.sin(azimuth),
                        math.sin(elevation),
                    ]
                )
                reach = 4.0 + 0.6 * math.sin(0.7 * stamp_ns * 1e-9 + row + col)
                to_target = m.target_pos - m.pos
                off = float(np.linalg.norm(out - to_target / np.linalg.norm(to_target)))
                if off < best_off:
                    best, best_off = row * 5 + col, off
                plan.candidates.add(
                    end_pos_world=vecf(m.pos + reach * out),
                    end_vel_world=vecf(2.5 * out),
                    end_acc_world=vecf(np.zeros(3)),
                    cost=0.5 + off + 0.1 * row,
                    added_obstacle=0.25 if row == 2 else 0.0,
                    objectness=math.exp(-3 * off * off),
                    target_pos_world=vecf(m.target_pos + self.np_rng.normal(0, 0.1, 3)),
                    rejection=pb.REJECTION_OBJECTNESS if off > 0.75 else pb.REJECTION_COST,
                )
        plan.candidates[best].rejection = pb.REJECTION_NONE
        plan.chosen = best
        return plan

    def control(self, m: Motion, seq: int, stamp_ns: int) -> pb.Control:
        """A controller step that agrees with the motion."""
        gust = np.array([0.6 * math.sin(0.4 * stamp_ns * 1e-9), 0.5, 0.1])
        noise = self.np_rng.normal(0, 0.15, 3)
        return pb.Control(
            seq=seq,
            stamp_ns=stamp_ns,
            mode=self.mode,
            pos_world=vec(m.pos),
            vel_world=vec(m.vel),
            world_from_body=wxyz(m.yaw, 0.12 if self.mode == pb.MODE_TRACK else 0.0),
            acc_des_world=vec(m.acc),
            acc_att_world=vec(m.acc - gust),
            acc_disturbance_world=vec(gust),
            acc_meas_world=vec(m.acc + noise),
            disturbance_limit_mps2=6.0,
            world_from_body_des=wxyz(m.yaw, 0.12),
            thrust_n=8.3,
            thrust_norm=0.24,
            yaw_des_rad=m.yaw,
            plan_seq=seq,
            plan_age_s=0.02,
            hover_thrust=0.314,
            attitude_lag_s=0.084,
        )

    def map(self, m: Motion, seq: int, stamp_ns: int) -> pb.ObstacleMap:
        """A wall beside the way."""
        return pb.ObstacleMap(
            seq=seq,
            stamp_ns=stamp_ns,
            origin_world=vec(m.pos + np.array([1.0, 1.5, -1.0])),
            voxel_m=0.2,
            voxels=bytes(n for along in range(12) for up in range(10) for n in (along, 0, up)),
            depth=self.depth(m, stamp_ns),
        )

    def depth(self, m: Motion, stamp_ns: int) -> pb.DepthBlocks:
        """Of upright trunks where its trees stand, and of flat ground."""
        left_W = math.tan(HFOV_RAD / 2) * (1 - (2 * np.arange(40) + 1) / 40)
        up_H = math.tan(VFOV_RAD / 2) * (1 - (2 * np.arange(24) + 1) / 24)
        forward_2, left_2 = np.array([(math.cos(m.yaw), math.sin(m.yaw)), (-math.sin(m.yaw), math.cos(m.yaw))])
        off_K2 = np.array([(tree.base_world.x, tree.base_world.y) for tree in self.trees]) - m.pos[:2]
        ahead_K, radius_K = off_K2 @ forward_2, np.array([tree.radius_m for tree in self.trees])
        hit_WK = (ahead_K > 1.0) & (np.abs(off_K2 @ left_2 - left_W[:, None] * ahead_K) < radius_K)
        trunk_W = np.where(hit_WK, ahead_K, math.inf).min(axis=1)
        ground_H = np.where(up_H < 0.0, m.pos[2] / np.maximum(-up_H, 1e-6), math.inf)
        nearest_HW = np.minimum(trunk_W[None, :], ground_H[:, None])
        steps_HW = np.where(nearest_HW < 25.0, np.rint(10 * np.minimum(nearest_HW, 25.0)), 0)
        return pb.DepthBlocks(
            frame_ns=stamp_ns,
            cam_world=vec(m.pos),
            world_from_cam=wxyz(m.yaw),
            hfov_rad=HFOV_RAD,
            vfov_rad=VFOV_RAD,
            nearest_dm=steps_HW.astype(np.uint8).tobytes(),
        )

    def target(self, m: Motion, seq: int, stamp_ns: int) -> pb.Target:
        """The target with some error."""
        cov = np.diag([0.04, 0.02, 0.02, 0.4, 0.4, 0.2])
        cov[0, 1] = cov[1, 0] = 0.015
        off_3 = self.np_rng.normal(0, 0.05, 3)
        look = pb.TargetLook(
            detections=3,
            passed=2,
            gate_sigmas=5.0,
            innovation_world=vec(off_3),
            innovation_sigmas=float(np.linalg.norm(off_3)) / 0.2,
            objectness=0.93,
            rival_pos_world=vec(m.target_pos + np.array([1.0, 4.0, 0.0])),
            rival_objectness=0.35,
            rival_needed=0.85,
        )
        return pb.Target(
            seq=seq,
            stamp_ns=stamp_ns,
            pos_world=vec(m.target_pos + self.np_rng.normal(0, 0.05, 3)),
            vel_world=vec(m.target_vel),
            covariance_upper=cov[np.triu_indices(6)].tolist(),
            confirmed=self.mode == pb.MODE_TRACK,
            since_seen_s=0.02,
            look=look,
        )

    def health(self, seq: int, stamp_ns: int) -> pb.Health:
        """The heartbeat."""
        ready = self.mode != pb.MODE_IDLE
        health = pb.Health(
            seq=seq,
            stamp_ns=stamp_ns,
            mode=self.mode,
            ready=ready,
            vehicle=self.args.vehicle,
            profile="normal",
            policy_sha256="c0ffee" * 10,
            version="0.1.0-fake",
            battery_fraction=self.args.battery,
            log_path="logs/fake.mcap",
            protocol=self.args.protocol,
            autopilot="OFFBOARD" if ready else "HOLD",
            profiles=["normal", "fast"],
        )
        health.checks.add(name="odometry", ok=ready, reason="fresh, 100 Hz" if ready else "no odometry yet")
        health.checks.add(name="camera", ok=True, reason="60 Hz")
        health.checks.add(name="policy", ok=True, reason="contract honoured")
        health.checks.add(name="battery", ok=True, reason="83 %")
        for name, hz in (("camera", 60.0), ("planner", 60.0), ("controller", 200.0), ("odometry", 100.0)):
            health.rates.add(name=name, hz=hz + self.rng.uniform(-0.5, 0.5))
        health.latencies.add(name="frame_to_plan", p50_ms=2.4, p99_ms=3.9, max_ms=5.1, count=1000)
        health.latencies.add(name="controller_step", p50_ms=0.0011, p99_ms=0.0016, max_ms=0.02, count=5000)
        health.drops.add(name="telemetry", count=0)
        return health

    def preview(self, m: Motion, seq: int, stamp_ns: int) -> pb.Preview:
        """A drawn picture: sky, ground, and the target."""
        image = Image.new("RGB", (160, 96), (126, 160, 196))
        draw = ImageDraw.Draw(image)
        draw.rectangle((0, 50, 160, 96), fill=(92, 104, 72))
        bearing = math.atan2(*(m.target_pos - m.pos)[1::-1]) - m.yaw
        u = 80 - 80 * math.tan(bearing)
        draw.rectangle((u - 4, 40, u + 4, 66), fill=(220, 90, 40))
        for k in range(6):
            x = (k * 31 - 12 * m.pos[0]) % 180 - 10
            draw.rectangle((x, 8, x + 5, 62), fill=(70, 52, 40))
        out = io.BytesIO()
        image.save(out, format="JPEG", quality=70)
        return pb.Preview(seq=seq, stamp_ns=stamp_ns, width=160, height=96, jpeg=out.getvalue())

    def truth(self, m: Motion, stamp_ns: int) -> pb.SimTruth:
        """The stand-in for the simulator's truth."""
        return pb.SimTruth(
            stamp_ns=stamp_ns,
            pos_world=vec(m.pos),
            world_from_body=wxyz(m.yaw),
            vel_world=vec(m.vel),
            acc_world=vec(m.acc),
            target_pos_world=vec(m.target_pos),
            target_vel_world=vec(m.target_vel),
            clearance_m=1.2 + 0.5 * math.sin(m.path_m),
            collisions=0,
            target_distance_m=float(np.linalg.norm(m.target_pos - m.pos)),
            target_path_m=m.path_m,
            target_arrived=m.path_m >= 40.0,
            target_visible=self.mode == pb.MODE_TRACK,
        )

    def world(self) -> pb.SimWorld:
        """A forest that leaves the target's way clear."""
        world = pb.SimWorld(seed=self.args.seed, spacing_m=5.0)
        rng = np.random.default_rng(self.args.seed)
        for x, y in rng.uniform((-10, -20), (70, 20), (90, 2)):
            if abs(y - target_at(x - 6.0)[0][1]) < 1.4:
                continue
            height = rng.uniform(4, 8)
            world.trees.add(
                base_world=vecf(np.array([x, y, 0.0])),
                top_world=vecf(np.array([x, y, 0.0]) + [*(rng.normal(0, 0.25, 2)), height]),
                radius_m=rng.uniform(0.1, 0.35),
                foliage_radius_m=rng.uniform(0.8, 1.6),
            )
        return world


def publish(session: zenoh.Session, fake: FakeVehicle, stop: threading.Event) -> None:
    """Puts every channel at its rate until told to stop."""
    args = fake.args
    rates_hz = {
        "control": 50.0,
        "plan": 60.0,
        "map": 1.0,
        "target": 60.0,
        "health": 2.0,
        "preview": 10.0,
        "sim_truth": 50.0,
    }
    publishers = {
        name: session.declare_publisher(
            key_expression(name, args.vehicle),
            encoding=KEYS[name].encoding,
            priority=KEYS[name].priority,
            congestion_control=KEYS[name].congestion,
            express=KEYS[name].express,
        )
        for name in (*rates_hz, "event")
    }
    seqs = dict.fromkeys(publishers, 0)
    due_s = dict.fromkeys(rates_hz, 0.0)
    born = time.monotonic()
    before_s = 0.0
    while not stop.is_set():
        now_s = time.monotonic() - born
        stamp_ns = int((now_s + args.clock) * 1e9)
        event = fake.step(now_s, now_s - before_s)
        before_s = now_s
        if event:
            publishers["event"].put(
                pb.Event(stamp_ns=stamp_ns, severity=pb.SEVERITY_INFO, kind="mode", text=event).SerializeToString()
            )
        m = fake.motion(now_s)
        for name, rate in rates_hz.items():
            if now_s < due_s[name]:
                continue
            due_s[name] = max(due_s[name] + 1.0 / rate, now_s - 0.1)
            if name in ("plan", "map", "target") and fake.mode != pb.MODE_TRACK:
                continue
            seqs[name] += 1
            if fake.rng.random() < args.lose:
                continue
            message: Any
            if name == "health":
                message = fake.health(seqs[name], stamp_ns)
            elif name == "sim_truth":
                message = fake.truth(m, stamp_ns)
            else:
                message = getattr(fake, name)(m, seqs[name], stamp_ns)
            publishers[name].put(message.SerializeToString() + (UNKNOWN if args.tomorrow else b""))
        if args.malformed:
            for name in ("plan", "control", "health"):
                publishers[name].put(b"\xff\xfenot protobuf")
            publishers["control"].put(pb.Control(seq=1, pos_world=pb.Vec3(x=math.nan)).SerializeToString())
        stop.wait(0.004)


def main() -> None:
    """Runs until SIGINT or SIGTERM."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--listen", required=True)
    parser.add_argument("--vehicle", default="goshawk")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--clock", type=float, default=1.0, help="what its clock shows at the start, s")
    parser.add_argument("--speed", type=float, default=3.0, help="the target's, m/s")
    parser.add_argument("--lose", type=float, default=0.0, help="share of samples not sent, their seq used up")
    parser.add_argument("--malformed", action="store_true", help="send rubbish beside the telemetry")
    parser.add_argument("--not-ready", action="store_true", help="stay idle")
    parser.add_argument("--battery", type=float, default=0.83, help="its fraction, 0 … 1")
    parser.add_argument("--identity", type=Path, help="folder of the vehicle's identity, where it listens by tls")
    parser.add_argument("--protocol", type=int, default=PROTOCOL, help="the count that the heartbeat carries")
    parser.add_argument("--tomorrow", action="store_true", help="every message has fields that nobody knows yet")
    parser.add_argument(
        "--acted", type=Path, help="a file that gets a line for each command that is acted on, not answered again"
    )
    parser.add_argument("--mute", action="store_true", help="answer no command")
    args = parser.parse_args()
    stop = threading.Event()

    def end(*_: object) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    config = zenoh.Config()
    if args.identity is not None:
        tls = {
            "root_ca_certificate": str(args.identity / "ca.pem"),
            "listen_certificate": str(args.identity / "cert.pem"),
            "listen_private_key": str(args.identity / "key.pem"),
            "enable_mtls": True,
        }
        config.insert_json5("transport/link/tls", json.dumps(tls))
    for key, value in {
        "mode": "peer",
        "listen/endpoints": [args.listen],
        "connect/endpoints": [],
        "scouting/multicast/enabled": False,
        "transport/link/tx/lease": 2000,
        # Two batches a priority, the default, lose samples as soon as a busy machine pauses the sender for 1 ms.
        "transport/link/tx/queue/size/interactive_high": 16,
        "transport/link/tx/queue/size/interactive_low": 8,
        "transport/link/tx/queue/size/background": 8,
    }.items():
        config.insert_json5(key, json.dumps(value))
    fake = FakeVehicle(args)
    born = time.monotonic()
    with zenoh.open(config) as session:

        def on_start(query: zenoh.Query) -> None:
            request = pb.StartRequest.FromString(query.payload.to_bytes() if query.payload else b"")
            answer = fake.command("start", request.command_id, request.profile, time.monotonic() - born)
            query.reply(query.key_expr, answer.SerializeToString() + (UNKNOWN if args.tomorrow else b""))

        def on_stop(query: zenoh.Query) -> None:
            request = pb.StopRequest.FromString(query.payload.to_bytes() if query.payload else b"")
            answer = fake.command("stop", request.command_id, "", time.monotonic() - born)
            query.reply(query.key_expr, answer.SerializeToString() + (UNKNOWN if args.tomorrow else b""))

        def on_world(query: zenoh.Query) -> None:
            query.reply(query.key_expr, fake.world().SerializeToString())

        def on_ping(query: zenoh.Query) -> None:
            query.reply(query.key_expr, b"")

        token = session.liveliness().declare_token(key_expression("alive_air", args.vehicle))
        kept = [session.declare_queryable(key_expression("sim_world", args.vehicle), on_world)]
        if not args.mute:
            kept.append(session.declare_queryable(key_expression("ping", args.vehicle), on_ping))
            kept.append(session.declare_queryable(key_expression("cmd_start", args.vehicle), on_start))
            kept.append(session.declare_queryable(key_expression("cmd_stop", args.vehicle), on_stop))
        print("listening", flush=True)
        publish(session, fake, stop)
        token.undeclare()


if __name__ == "__main__":
    main()
