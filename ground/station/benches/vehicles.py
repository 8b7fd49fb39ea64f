"""Many vehicles in one process, for the dashboard's benchmark: real Zenoh sessions, messages of real size.

python vehicles.py ENDPOINT …        one vehicle v0, v1 … an endpoint; prints `listening` once all do
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from typing import Any

import zenoh
from goshawk_proto import KEYS, key_expression
from goshawk_proto import goshawk_pb2 as pb

RATE_HZ = 30.0
HEALTH_EVERY = 15
CANDIDATES = 15


def plan(seq: int, now_ns: int) -> pb.Plan:
    """15 candidates with detections, in flight."""
    far = pb.Vec3f(x=14.2, y=-1.7, z=2.3)
    message = pb.Plan(
        seq=seq,
        frame_ns=now_ns,
        ready_ns=now_ns + 3_000_000,
        start_pos_world=pb.Vec3(x=10.1 + 0.01 * seq, y=0.2, z=2.1),
        start_vel_world=pb.Vec3(x=3.1, y=0.2, z=0.1),
        start_acc_world=pb.Vec3(x=0.3, y=0.2, z=0.1),
        world_from_cam=pb.Quat(w=1.0),
        duration_s=1.67,
        alpha=1.1,
        chosen=7,
    )
    for k in range(CANDIDATES):
        message.candidates.add(
            end_pos_world=far,
            end_vel_world=pb.Vec3f(x=3.0, y=0.1 * k, z=0.1),
            end_acc_world=pb.Vec3f(x=0.1, y=0.1, z=0.1),
            cost=1.0 + 0.1 * k,
            objectness=0.4,
            target_pos_world=far,
            rejection=pb.REJECTION_NONE if k == 7 else pb.REJECTION_COST,
        )
    return message


def control(seq: int, now_ns: int) -> pb.Control:
    """One controller step, every field set."""
    v = pb.Vec3(x=1.1, y=0.2 * (seq % 7), z=0.3)
    return pb.Control(
        seq=seq,
        stamp_ns=now_ns,
        mode=pb.MODE_TRACK,
        pos_world=pb.Vec3(x=10.1 + 0.01 * seq, y=0.2, z=2.1),
        vel_world=v,
        world_from_body=pb.Quat(w=1.0),
        acc_des_world=v,
        acc_att_world=v,
        acc_disturbance_world=v,
        acc_meas_world=v,
        world_from_body_des=pb.Quat(w=1.0),
        thrust_n=8.3,
        thrust_norm=0.24,
        yaw_des_rad=0.1,
        plan_seq=seq,
        plan_age_s=0.02,
    )


def target(seq: int, now_ns: int) -> pb.Target:
    """A confirmed target."""
    return pb.Target(
        seq=seq,
        stamp_ns=now_ns,
        pos_world=pb.Vec3(x=15.0 + 0.01 * seq, y=0.3, z=0.95),
        vel_world=pb.Vec3(x=3.0),
        covariance_upper=[0.04 if row == column else 0.0 for row in range(6) for column in range(row, 6)],
        confirmed=True,
        since_seen_s=0.02,
    )


def health(seq: int, now_ns: int, vehicle: str) -> pb.Health:
    """A heartbeat."""
    message = pb.Health(seq=seq, stamp_ns=now_ns, mode=pb.MODE_TRACK, ready=True, vehicle=vehicle, profile="chase")
    message.battery_fraction = 0.8
    for name in ("camera", "odometry", "autopilot", "policy", "battery", "recorder"):
        message.checks.add(name=name, ok=True)
    for name, hz in (("camera", 30.0), ("planner", 30.0), ("controller", 200.0), ("odometry", 100.0)):
        message.rates.add(name=name, hz=hz)
    for name in ("frame_to_plan", "inference", "controller_step"):
        message.latencies.add(name=name, p50_ms=2.4, p99_ms=3.9, max_ms=5.1, count=1000)
    return message


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """One open session and its publishers by key name."""

    name: str
    session: zenoh.Session
    publishers: dict[str, zenoh.Publisher]
    kept: list[Any]


def open_vehicle(name: str, endpoint: str) -> Vehicle:
    """Listens, and is alive."""
    config = zenoh.Config()
    for key, value in {
        "mode": "peer",
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/link/tx/lease": 2000,
    }.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    publishers = {
        row: session.declare_publisher(
            key_expression(row, name),
            encoding=KEYS[row].encoding,
            priority=KEYS[row].priority,
            congestion_control=KEYS[row].congestion,
            express=KEYS[row].express,
        )
        for row in ("plan", "control", "target", "health")
    }
    token = session.liveliness().declare_token(key_expression("alive_air", name))
    return Vehicle(name=name, session=session, publishers=publishers, kept=[token])


def main() -> None:
    """Publishes until it is ended."""
    vehicles = [open_vehicle(f"v{k}", endpoint) for k, endpoint in enumerate(sys.argv[1:])]
    print("listening", flush=True)
    seq, due = 0, time.monotonic()
    while True:
        seq += 1
        now_ns = time.monotonic_ns()
        messages = {"plan": plan(seq, now_ns), "control": control(seq, now_ns), "target": target(seq, now_ns)}
        payloads = {name: message.SerializeToString() for name, message in messages.items()}
        for vehicle in vehicles:
            for name, payload in payloads.items():
                vehicle.publishers[name].put(payload)
            if seq % HEALTH_EVERY == 0:
                message = health(seq // HEALTH_EVERY, now_ns, vehicle.name)
                vehicle.publishers["health"].put(message.SerializeToString())
        due += 1.0 / RATE_HZ
        time.sleep(max(0.0, due - time.monotonic()))


if __name__ == "__main__":
    main()
