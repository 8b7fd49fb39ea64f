"""From messages of the wire to the views of a snapshot, validated once, here.

Each function raises ``MalformedError`` (one line: the message and what is wrong with it) if a value is not finite, a
position is beyond all measure, or a length is not what it must be. An enum value that this version does not know
passes; `words` shows its number.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.state import views as view

MAX_CANDIDATES = 256
"""More than any lattice has: a bound on what one message may make us draw."""
MAX_BOXES = 20_000
"""What a simulator sends at most."""
MAX_VOXELS = 20_000
"""More than a vehicle tells of what it remembers."""
DEPTH_BLOCKS = (24, 40)
"""Rows and columns."""
FARTHEST = 1e9
"""Of a position, a velocity or an acceleration: what is larger was never measured, and its square may be none."""
LONGEST_PLAN_S = 600.0
"""Far more than any policy plans: a bound on how many points one message may make us draw."""


class MalformedError(ValueError):
    """A payload that parses as protobuf but makes no sense."""


def _array(what: str, values: Any, shape: tuple[int, ...]) -> view.Array:
    array = np.array(values, dtype=np.float64).reshape(shape)
    if not np.isfinite(array).all():
        raise MalformedError(f"{what} is not finite")
    array.setflags(write=False)
    return array


def _vec(what: str, v: pb.Vec3) -> view.Array:
    return _near(what, _array(what, (v.x, v.y, v.z), (3,)))


def _vecs(what: str, vs: Iterable[pb.Vec3f]) -> view.Array:
    return _near(what, _array(what, [(v.x, v.y, v.z) for v in vs], (-1, 3)))


def _near(what: str, array: view.Array) -> view.Array:
    if (np.abs(array) > FARTHEST).any():
        raise MalformedError(f"{what} is beyond {FARTHEST:.0e}")
    return array


def _quat(what: str, q: pb.Quat) -> view.Array:
    array = np.array((q.w, q.x, q.y, q.z))
    norm = float(np.linalg.norm(array))
    if not (math.isfinite(norm) and norm > 0.5):
        raise MalformedError(f"{what} is not a unit quaternion")
    return _array(what, array / norm, (4,))


def _number(what: str, value: float) -> float:
    if not math.isfinite(value):
        raise MalformedError(f"{what} is not finite")
    return value


def plan(m: pb.Plan) -> view.PlanView:
    """A plan; every candidate complete, ``chosen`` one of them, duration positive."""
    cands = m.candidates
    if len(cands) > MAX_CANDIDATES:
        raise MalformedError(f"plan has {len(cands)} candidates, at most {MAX_CANDIDATES} are read")
    chosen = m.chosen if m.HasField("chosen") else None
    if chosen is not None and chosen >= len(cands):
        raise MalformedError(f"plan chose candidate {chosen} of {len(cands)}")
    if not 0.0 < m.duration_s <= LONGEST_PLAN_S:
        raise MalformedError(f"plan lasts {m.duration_s} s")
    detections = all(c.HasField("target_pos_world") for c in cands) and len(cands) > 0
    return view.PlanView(
        seq=m.seq,
        frame_ns=m.frame_ns,
        ready_ns=m.ready_ns,
        start_pos_world_3=_vec("plan start position", m.start_pos_world),
        start_vel_world_3=_vec("plan start velocity", m.start_vel_world),
        start_acc_world_3=_vec("plan start acceleration", m.start_acc_world),
        world_from_cam_4=_quat("plan camera attitude", m.world_from_cam),
        duration_s=m.duration_s,
        alpha=_number("plan alpha", m.alpha),
        end_pos_world_N3=_vecs("candidate position", (c.end_pos_world for c in cands)),
        end_vel_world_N3=_vecs("candidate velocity", (c.end_vel_world for c in cands)),
        end_acc_world_N3=_vecs("candidate acceleration", (c.end_acc_world for c in cands)),
        cost_N=_array("candidate cost", [c.cost for c in cands], (-1,)),
        added_NP=_array(
            "what is added to a cost",
            [[getattr(c, f"added_{part}") for part in view.ADDED] for c in cands],
            (-1, len(view.ADDED)),
        ),
        objectness_N=_array("candidate objectness", [c.objectness for c in cands], (-1,)),
        rejections=tuple(c.rejection for c in cands),
        target_pos_world_N3=_vecs("candidate detection", (c.target_pos_world for c in cands)) if detections else None,
        chosen=chosen,
    )


def remembered(m: pb.ObstacleMap) -> view.RememberedView:
    """The map of what stands; three bytes a voxel, and an edge."""
    if len(m.voxels) % 3 or len(m.voxels) > 3 * MAX_VOXELS:
        raise MalformedError(f"map has {len(m.voxels)} bytes, not three a voxel of {MAX_VOXELS} at most")
    if not 0.0 < m.voxel_m <= FARTHEST:
        raise MalformedError(f"map has voxels of {m.voxel_m} m")
    return view.RememberedView(
        seq=m.seq,
        stamp_ns=m.stamp_ns,
        origin_world_3=_vec("map origin", m.origin_world),
        voxel_m=m.voxel_m,
        cells_V3=np.frombuffer(m.voxels, dtype=np.uint8).reshape(-1, 3),
        depth=_depth(m.depth) if m.HasField("depth") else None,
    )


def _depth(m: pb.DepthBlocks) -> view.DepthView:
    if len(m.nearest_dm) != math.prod(DEPTH_BLOCKS):
        raise MalformedError(f"map has depth of {len(m.nearest_dm)} blocks, not {math.prod(DEPTH_BLOCKS)}")
    if not all(0.0 < fov_rad < math.pi for fov_rad in (m.hfov_rad, m.vfov_rad)):
        raise MalformedError(f"map has depth of a camera that sees {m.hfov_rad} by {m.vfov_rad} rad")
    return view.DepthView(
        frame_ns=m.frame_ns,
        cam_world_3=_vec("lens position", m.cam_world),
        world_from_cam_4=_quat("camera attitude", m.world_from_cam),
        hfov_rad=m.hfov_rad,
        vfov_rad=m.vfov_rad,
        nearest_m_HW=0.1 * np.frombuffer(m.nearest_dm, dtype=np.uint8).reshape(DEPTH_BLOCKS).astype(np.float64),
    )


def control(m: pb.Control) -> view.ControlView:
    """A controller step."""
    return view.ControlView(
        seq=m.seq,
        stamp_ns=m.stamp_ns,
        mode=m.mode,
        fallback=m.fallback,
        pos_world_3=_vec("control position", m.pos_world),
        vel_world_3=_vec("control velocity", m.vel_world),
        world_from_body_4=_quat("control attitude", m.world_from_body),
        acc_des_world_3=_vec("desired acceleration", m.acc_des_world),
        acc_att_world_3=_vec("attitude acceleration", m.acc_att_world),
        acc_disturbance_world_3=_vec("disturbance", m.acc_disturbance_world),
        disturbance_limit_mps2=_number("disturbance limit", m.disturbance_limit_mps2) or None,
        acc_meas_world_3=_vec("measured acceleration", m.acc_meas_world) if m.HasField("acc_meas_world") else None,
        thrust_n=_number("thrust", m.thrust_n),
        thrust_norm=_number("normalised thrust", m.thrust_norm),
        yaw_des_rad=_number("desired yaw", m.yaw_des_rad),
        plan_age_s=_number("plan age", m.plan_age_s) if m.HasField("plan_age_s") else None,
        # None of the three can be 0; it is what an older vehicle, which does not send them, is read as.
        hover_thrust=_number("hover thrust", m.hover_thrust) or None,
        attitude_lag_s=_number("attitude lag", m.attitude_lag_s) or None,
    )


def target(m: pb.Target) -> view.TargetView:
    """A target estimate; its covariance has 21 values or none."""
    if len(m.covariance_upper) not in (0, 21):
        raise MalformedError(f"target covariance has {len(m.covariance_upper)} values, not 21")
    return view.TargetView(
        seq=m.seq,
        stamp_ns=m.stamp_ns,
        pos_world_3=_vec("target position", m.pos_world),
        vel_world_3=_vec("target velocity", m.vel_world),
        covariance_66=_symmetric("target covariance", m.covariance_upper) if m.covariance_upper else None,
        confirmed=m.confirmed,
        since_seen_s=_number("target since_seen", m.since_seen_s),
        look=_look(m.look) if m.HasField("look") else None,
    )


def _symmetric(what: str, upper: Any) -> view.Array:
    """The whole matrix, of its values on and above the diagonal, by rows."""
    whole_66 = np.zeros((6, 6))
    rows, columns = np.triu_indices(6)
    whole_66[rows, columns] = whole_66[columns, rows] = _array(what, upper, (21,))
    return whole_66


def _look(m: pb.TargetLook) -> view.LookView:
    taken, rival = m.HasField("innovation_world"), m.HasField("rival_pos_world")
    gate_sigmas = _number("target gate", m.gate_sigmas)
    return view.LookView(
        detections=m.detections,
        passed=m.passed,
        # A gate of nothing lets nothing pass: it was not sent.
        gate_sigmas=gate_sigmas if gate_sigmas > 0.0 else None,
        innovation_world_3=_vec("target innovation", m.innovation_world) if taken else None,
        innovation_sigmas=_number("target innovation", m.innovation_sigmas) if taken else None,
        objectness=_number("target objectness", m.objectness) if taken else None,
        rival_pos_world_3=_vec("rival position", m.rival_pos_world) if rival else None,
        rival_objectness=_number("rival objectness", m.rival_objectness) if rival else None,
        rival_needed=_number("what the rival needs", m.rival_needed) if rival else None,
    )


def health(m: pb.Health) -> view.HealthView:
    """A heartbeat."""
    return view.HealthView(
        seq=m.seq,
        stamp_ns=m.stamp_ns,
        mode=m.mode,
        ready=m.ready,
        checks=tuple(view.CheckView(name=c.name, ok=c.ok, reason=c.reason) for c in m.checks),
        rates_hz=tuple((r.name, _number(f"rate {r.name}", r.hz)) for r in m.rates),
        latencies=tuple(
            view.LatencyView(
                name=x.name,
                p50_ms=_number(f"latency {x.name}", x.p50_ms),
                p99_ms=_number(f"latency {x.name}", x.p99_ms),
                max_ms=_number(f"latency {x.name}", x.max_ms),
            )
            for x in m.latencies
        ),
        drops=tuple((d.name, d.count) for d in m.drops),
        faults=tuple(m.faults),
        vehicle=m.vehicle,
        profile=m.profile,
        profiles=tuple(m.profiles),
        policy_sha256=m.policy_sha256,
        version=m.version,
        battery_fraction=_number("battery", m.battery_fraction) if m.HasField("battery_fraction") else None,
        log_path=m.log_path,
        autopilot=m.autopilot,
        protocol=m.protocol,
    )


def preview(m: pb.Preview) -> view.PreviewView:
    """A picture; whether the JPEG itself is sound shows when it is drawn."""
    if not m.jpeg:
        raise MalformedError("preview holds no picture")
    return view.PreviewView(seq=m.seq, stamp_ns=m.stamp_ns, width=m.width, height=m.height, picture=m.jpeg)


def event(m: pb.Event) -> view.EventView:
    """A state change."""
    return view.EventView(stamp_ns=m.stamp_ns, severity=m.severity, kind=m.kind, text=m.text)


def _boxes(what: str, boxes: Sequence[pb.SimBox]) -> view.BoxesView:
    if len(boxes) > MAX_BOXES:
        raise MalformedError(f"{len(boxes)} boxes {what}, at most {MAX_BOXES} are read")
    return view.BoxesView(
        centre_world_B3=_vecs(f"centre of a box {what}", (b.centre_world for b in boxes)),
        size_m_B3=_vecs(f"size of a box {what}", (b.size_m for b in boxes)),
        yaw_rad_B=_array(f"yaw of a box {what}", [b.yaw_rad for b in boxes], (-1,)),
    )


def truth(m: pb.SimTruth) -> view.TruthView:
    """The simulator's truth."""
    return view.TruthView(
        stamp_ns=m.stamp_ns,
        pos_world_3=_vec("true position", m.pos_world),
        vel_world_3=_vec("true velocity", m.vel_world),
        acc_world_3=_vec("true acceleration", m.acc_world) if m.HasField("acc_world") else None,
        target_pos_world_3=(
            _vec("true target position", m.target_pos_world) if m.HasField("target_pos_world") else None
        ),
        target_vel_world_3=_vec("true target velocity", m.target_vel_world),
        clearance_m=_number("clearance", m.clearance_m),
        collisions=m.collisions,
        target_distance_m=_number("target distance", m.target_distance_m),
        target_path_m=_number("target path", m.target_path_m),
        target_arrived=m.target_arrived,
        target_visible=m.target_visible,
        moving=_boxes("that moves", m.moving),
        goal_world_3=_vec("goal", m.goal_world) if m.HasField("goal_world") else None,
    )


def world(m: pb.SimWorld) -> view.WorldView:
    """What stands still in the simulator's world."""
    return view.WorldView(
        base_world_K3=_vecs("tree base", (t.base_world for t in m.trees)),
        top_world_K3=_vecs("tree top", (t.top_world for t in m.trees)),
        radius_m_K=_array("tree radius", [t.radius_m for t in m.trees], (-1,)),
        foliage_radius_m_K=_array("foliage radius", [t.foliage_radius_m for t in m.trees], (-1,)),
        boxes=_boxes("of the world", m.boxes),
        seed=m.seed,
        spacing_m=_number("spacing", m.spacing_m),
    )
