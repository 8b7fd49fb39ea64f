"""What a vehicle, its link and its operator said, part by part, as plain immutable values: a snapshot holds them.

Frames: ``*_world`` is ENU, body and camera are FLU; SI and radians; quaternions are (w, x, y, z), unit length.
Shape suffixes: N candidates, P parts of a cost, K trees, B boxes, V voxels, 3 a vector, 4 a quaternion. Arrays are
float64 (unless said), read-only.
Absence is ``None``. An ``age_s`` is seconds since the sample arrived on the ground, by the ground's clock.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from numpy.typing import NDArray

Array = NDArray[np.float64]

ADDED = ("obstacle", "mover", "target", "climbing")
"""The parts that the planner adds to a candidate's cost: it meets what stands and was seen, or what moves; it comes too
near to the target; it ends above the goal."""

UNSEEN_S = 0.5
"""A target out of sight for longer is lost to who looks, though the vehicle still pursues it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanView:
    """One planning step: N candidate trajectories, each as its end state."""

    seq: int
    frame_ns: int
    ready_ns: int
    start_pos_world_3: Array
    start_vel_world_3: Array
    start_acc_world_3: Array
    world_from_cam_4: Array
    duration_s: float
    """Duration of every trajectory, > 0."""
    alpha: float
    end_pos_world_N3: Array
    end_vel_world_N3: Array
    end_acc_world_N3: Array
    cost_N: Array
    """What the network expects, alone."""
    added_NP: Array
    """What the planner adds to it, one column for each of ADDED; zero of what is too dear already."""
    objectness_N: Array
    rejections: tuple[pb.Rejection, ...]
    """Why each candidate is not flown."""
    target_pos_world_N3: Array | None
    """Each candidate's detection; None in navigation."""
    chosen: int | None
    """Index of the trajectory flown; None: nothing was eligible."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DepthView:
    """What the camera measured of one image, the nearest in each block of it."""

    frame_ns: int
    cam_world_3: Array
    """Where the lens was."""
    world_from_cam_4: Array
    hfov_rad: float
    vfov_rad: float
    nearest_m_HW: Array
    """Along the optical axis; 0: none measured. The last step stands for all that is farther."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RememberedView:
    """What the planner remembers to stand about the vehicle: V occupied voxels, the nearest ones."""

    seq: int
    stamp_ns: int
    origin_world_3: Array
    """The lowest corner of voxel 0, 0, 0."""
    voxel_m: float
    """A voxel's edge, > 0."""
    cells_V3: NDArray[np.uint8]
    depth: DepthView | None = None
    """What the camera measured last; None: an older vehicle does not tell."""

    @property
    def centre_V3(self) -> Array:
        """Each voxel's centre, from the origin, m."""
        return (self.cells_V3.astype(np.float64) + 0.5) * self.voxel_m


@dataclass(frozen=True, kw_only=True, eq=False)
class ControlView:
    """One controller step."""

    seq: int
    stamp_ns: int
    mode: pb.Mode
    fallback: pb.Fallback
    """Rung of the controller's ladder; FALLBACK_NONE is the top."""
    pos_world_3: Array
    vel_world_3: Array
    world_from_body_4: Array
    acc_des_world_3: Array
    acc_att_world_3: Array
    acc_disturbance_world_3: Array
    disturbance_limit_mps2: float | None
    """The largest disturbance that the observer believes; None: the vehicle does not say."""
    acc_meas_world_3: Array | None
    """By the autopilot's IMU, turned and without gravity; None: it sends none."""
    thrust_n: float
    thrust_norm: float
    yaw_des_rad: float
    plan_age_s: float | None
    hover_thrust: float | None
    """The thrust that hovers, normalised, as learnt in flight; None: the vehicle does not say."""
    attitude_lag_s: float | None
    """How late the attitude follows its command, as learnt in flight; None: the vehicle does not say."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LookView:
    """What the target filter made of one frame's detections, compared with what it believed before."""

    detections: int
    """Sure enough to be looked at."""
    passed: int
    """Of these, within the gate."""
    gate_sigmas: float | None
    """None: the vehicle does not say."""
    innovation_world_3: Array | None
    """The detection that it took, minus where it expected it, m; None: none passed."""
    innovation_sigmas: float | None
    """That in standard deviations, to be compared with the gate."""
    objectness: float | None
    """Of the detection that it took."""
    rival_pos_world_3: Array | None
    """What is seen beside the target and may take its place; None: nothing is."""
    rival_objectness: float | None
    """The mean of its detections."""
    rival_needed: float | None
    """The mean from which on it takes the place, once it is seen often enough."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetView:
    """The target filter's estimate."""

    seq: int
    stamp_ns: int
    pos_world_3: Array
    vel_world_3: Array
    covariance_66: Array | None
    """Position then velocity; None when the vehicle does not send it."""
    confirmed: bool
    since_seen_s: float
    look: LookView | None
    """None: it held nothing to compare with, or the vehicle does not say."""


@dataclass(frozen=True, kw_only=True)
class CheckView:
    """One readiness check and why it fails (or what it saw)."""

    name: str
    ok: bool
    reason: str


@dataclass(frozen=True, kw_only=True)
class LatencyView:
    """One latency of the vehicle, milliseconds."""

    name: str
    p50_ms: float
    p99_ms: float
    max_ms: float


@dataclass(frozen=True, kw_only=True)
class HealthView:
    """The vehicle's heartbeat."""

    seq: int
    stamp_ns: int
    mode: pb.Mode
    ready: bool
    checks: tuple[CheckView, ...]
    rates_hz: tuple[tuple[str, float], ...]
    latencies: tuple[LatencyView, ...]
    drops: tuple[tuple[str, int], ...]
    faults: tuple[str, ...]
    vehicle: str
    profile: str
    profiles: tuple[str, ...]
    policy_sha256: str
    version: str
    battery_fraction: float | None
    log_path: str
    """Empty: not recording."""
    autopilot: str
    protocol: int
    """The vehicle's count of the wire's changes; 0: from before it was counted."""


@dataclass(frozen=True, kw_only=True)
class PreviewView:
    """The vehicle's newest small picture, still compressed."""

    seq: int
    stamp_ns: int
    width: int
    height: int
    picture: bytes
    """JPEG from the link, PNG from a log."""


@dataclass(frozen=True, kw_only=True)
class EventView:
    """A state change worth reading."""

    stamp_ns: int
    severity: pb.Severity
    kind: str
    text: str
    late: bool = False
    """It was told afterwards: the link was away when it happened, or was not there yet."""


@dataclass(frozen=True, kw_only=True, eq=False)
class BoxesView:
    """B upright boxes of the simulated world."""

    centre_world_B3: Array
    size_m_B3: Array
    """Edges along each box's own axes."""
    yaw_rad_B: Array
    """From east to north, to a box's own x axis."""

    def __len__(self) -> int:
        return len(self.yaw_rad_B)


@dataclass(frozen=True, kw_only=True, eq=False)
class TruthView:
    """The simulator's truth; absent in real flight."""

    stamp_ns: int
    pos_world_3: Array
    vel_world_3: Array
    acc_world_3: Array | None
    """None: a log from before it was told."""
    target_pos_world_3: Array | None
    """None: nobody runs."""
    target_vel_world_3: Array
    clearance_m: float
    collisions: int
    target_distance_m: float
    target_path_m: float
    target_arrived: bool
    target_visible: bool
    moving: BoxesView
    """Boxes around the moving obstacles, now."""
    goal_world_3: Array | None = None
    """Where a navigation leads, on the ground; None: somebody is chased, or a log from before it was told."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WorldView:
    """What stands still in the simulator's world."""

    base_world_K3: Array
    top_world_K3: Array
    radius_m_K: Array
    foliage_radius_m_K: Array
    boxes: BoxesView
    """Walls, furniture, a scan's merged voxels."""
    seed: int
    spacing_m: float


@dataclass(frozen=True, kw_only=True)
class ChannelView:
    """How one telemetry channel arrives, over the last few seconds."""

    name: str
    count: int
    """Well-formed samples since the link was opened."""
    age_s: float | None
    """Seconds since the last one; None: none yet."""
    rate_hz: float
    bytes_per_s: float
    loss_fraction: float | None
    """Lost of sent, by the gaps in ``seq``; None: the channel has no ``seq`` or too few samples."""
    malformed: int
    """Payloads that could not be read, since the link was opened."""


@dataclass(frozen=True, kw_only=True)
class CommandView:
    """What became of the last command sent from here."""

    verb: str
    command_id: str
    answered: bool
    """False: no reply came in time; ``text`` says what to check."""
    accepted: bool
    text: str
    mode: pb.Mode | None
    """The vehicle's mode when it replied; None without a reply."""
    refused_here: bool = False
    """The ground did not send it; ``text`` says why."""
    cancelled: bool = False
    """A Stop that the operator took back before the vehicle confirmed it."""
    pending: bool = False
    """Sent, and still waiting for the reply."""
    at_s: float | None = None
    """When it was sent, by the ground's monotonic clock."""
    took_s: float | None = None
    """From the press to the reply; None while there is none."""


@dataclass(frozen=True, kw_only=True)
class StopView:
    """A Stop that the vehicle has not confirmed."""

    command_id: str
    age_s: float
    """Seconds since it was pressed."""
    resumed: bool = False
    """It was pressed before the ground was started anew."""
    lapsed: bool = False
    """It was too old for that: it is shown, and not asked."""
    trouble: str = ""
    """Why a restart of the ground would forget it, one line; empty: it would not."""


@dataclass(frozen=True, kw_only=True)
class AutopilotView:
    """What the autopilot says over its own telemetry radio, beside the vehicle's link."""

    source: str
    """Where it is listened for, such as udpin:0.0.0.0:14550."""
    age_s: float | None
    """Seconds since its last heartbeat; None: none yet."""
    mode: str = ""
    """Its flight mode in the autopilot's words."""
    armed: bool = False
    battery_fraction: float | None = None
    battery_v: float | None = None
    loss_fraction: float | None = None
    """Lost of sent, by MAVLink's sequence numbers; None: too few messages."""
    radio_rssi: tuple[int, int] | None = None
    """The radio's own account of its signal, (here, remote), 0..254; None: the radio says nothing."""
    rate_hz: float = 0.0
    """Messages a second."""
    failsafe: bool = False
    """Its heartbeat says critical or emergency."""
    texts: tuple[tuple[pb.Severity, str], ...] = ()
    """The newest status texts, newest last, as (severity, text); bounded."""
    trouble: str = ""
    """Why nothing can be heard, one line; empty: all is well."""
