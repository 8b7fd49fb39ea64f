"""Snapshots to draw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from goshawk_dashboards.state import views as view
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from made_up import IDENTITY_4, make_plan


def _channel(name: str, age_s: float) -> view.ChannelView:
    return view.ChannelView(
        name=name, count=9, age_s=age_s, rate_hz=50.0, bytes_per_s=1e4, loss_fraction=0.0, malformed=0
    )


def make_control(seq: int = 1, stamp_s: float = 1.0, mode: pb.Mode = pb.MODE_TRACK) -> view.ControlView:
    """Flying at (10, 0, 2)."""
    return view.ControlView(
        seq=seq,
        stamp_ns=int(stamp_s * 1e9),
        mode=mode,
        fallback=pb.FALLBACK_NONE,
        pos_world_3=np.array([10.0, 0.0, 2.0]),
        vel_world_3=np.array([3.0, 0.0, 4.0]),
        world_from_body_4=IDENTITY_4,
        acc_des_world_3=np.array([1.0, 2.0, 3.0]),
        acc_att_world_3=np.zeros(3),
        acc_disturbance_world_3=np.array([0.0, 1.0, 0.0]),
        disturbance_limit_mps2=6.0,
        acc_meas_world_3=np.ones(3),
        thrust_n=8.3,
        thrust_norm=0.3,
        yaw_des_rad=0.0,
        plan_age_s=0.02,
        hover_thrust=0.314,
        attitude_lag_s=0.084,
    )


def make_target() -> view.TargetView:
    """A confirmed target."""
    return view.TargetView(
        seq=1,
        stamp_ns=1,
        pos_world_3=np.array([14.0, 1.0, 0.95]),
        vel_world_3=np.array([3.0, 0.0, 0.0]),
        covariance_66=np.diag([0.04, 0.01, 0.09, 1.0, 1.0, 1.0]),
        confirmed=True,
        since_seen_s=0.02,
        look=view.LookView(
            detections=3,
            passed=1,
            gate_sigmas=5.0,
            innovation_world_3=np.array([0.0, 0.2, 0.0]),
            innovation_sigmas=0.7,
            objectness=0.91,
            rival_pos_world_3=np.array([14.0, 5.0, 0.95]),
            rival_objectness=0.35,
            rival_needed=0.8,
        ),
    )


def make_health(mode: pb.Mode = pb.MODE_TRACK, ready: bool = True, reason: str = "fresh") -> view.HealthView:
    """A heartbeat with one check."""
    return view.HealthView(
        seq=1,
        stamp_ns=1,
        mode=mode,
        ready=ready,
        checks=(view.CheckView(name="odometry", ok=ready, reason=reason),),
        rates_hz=(("planner", 60.0),),
        latencies=(view.LatencyView(name="inference", p50_ms=1.0, p99_ms=2.0, max_ms=3.0),),
        drops=(("telemetry", 3),),
        faults=(),
        vehicle="goshawk",
        profile="chase",
        profiles=("chase", "fast"),
        policy_sha256="abc",
        version="0.1.0",
        battery_fraction=0.5,
        log_path="",
        autopilot="OFFBOARD",
        protocol=PROTOCOL,
    )


@pytest.fixture
def snap() -> Callable[..., Snapshot]:
    """A snapshot of a flight, each channel ``age_s`` old; fields may be replaced."""

    def make(age_s: float = 0.02, **changes: Any) -> Snapshot:
        names = ("plan", "map", "control", "target", "health", "preview", "event", "sim_truth")
        whole = Snapshot(
            now_s=100.0,
            vehicle="goshawk",
            endpoint="tcp/127.0.0.1:7447",
            linked=True,
            alive=True,
            plan=make_plan(),
            control=make_control(),
            target=make_target(),
            health=make_health(),
            channels=tuple(_channel(name, age_s) for name in names),
        )
        return replace(whole, **changes)

    return make
