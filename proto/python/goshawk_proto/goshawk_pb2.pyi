from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Mode(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    MODE_UNSPECIFIED: _ClassVar[Mode]
    MODE_IDLE: _ClassVar[Mode]
    MODE_READY: _ClassVar[Mode]
    MODE_TAKEOFF: _ClassVar[Mode]
    MODE_TRACK: _ClassVar[Mode]
    MODE_NAVIGATE: _ClassVar[Mode]
    MODE_SEARCH: _ClassVar[Mode]
    MODE_HOLD: _ClassVar[Mode]
    MODE_STOPPING: _ClassVar[Mode]
    MODE_LANDED: _ClassVar[Mode]
    MODE_FAULT: _ClassVar[Mode]

class Task(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    TASK_UNSPECIFIED: _ClassVar[Task]
    TASK_TRACK: _ClassVar[Task]
    TASK_NAVIGATE: _ClassVar[Task]

class Fallback(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    FALLBACK_NONE: _ClassVar[Fallback]
    FALLBACK_PLAN_EXPIRED_BRAKE: _ClassVar[Fallback]
    FALLBACK_HOLD_POSITION: _ClassVar[Fallback]
    FALLBACK_ODOMETRY_FALSE_BRAKE: _ClassVar[Fallback]
    FALLBACK_ODOMETRY_STALE_DESCEND: _ClassVar[Fallback]
    FALLBACK_HAND_BACK: _ClassVar[Fallback]

class OdometryFault(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    ODOMETRY_FAULT_NONE: _ClassVar[OdometryFault]
    ODOMETRY_FAULT_POSITION_JUMPED: _ClassVar[OdometryFault]
    ODOMETRY_FAULT_POSITION_DISAGREES: _ClassVar[OdometryFault]
    ODOMETRY_FAULT_VELOCITY_STEPPED: _ClassVar[OdometryFault]
    ODOMETRY_FAULT_ATTITUDE_TURNED: _ClassVar[OdometryFault]
    ODOMETRY_FAULT_HEADING_DISAGREES: _ClassVar[OdometryFault]
    ODOMETRY_FAULT_FROZEN: _ClassVar[OdometryFault]

class Rejection(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    REJECTION_NONE: _ClassVar[Rejection]
    REJECTION_OBJECTNESS: _ClassVar[Rejection]
    REJECTION_GATE: _ClassVar[Rejection]
    REJECTION_COST: _ClassVar[Rejection]
    REJECTION_INVALID: _ClassVar[Rejection]
    REJECTION_BLOCKED: _ClassVar[Rejection]

class Severity(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
    __slots__ = ()
    SEVERITY_UNSPECIFIED: _ClassVar[Severity]
    SEVERITY_INFO: _ClassVar[Severity]
    SEVERITY_WARNING: _ClassVar[Severity]
    SEVERITY_ERROR: _ClassVar[Severity]
MODE_UNSPECIFIED: Mode
MODE_IDLE: Mode
MODE_READY: Mode
MODE_TAKEOFF: Mode
MODE_TRACK: Mode
MODE_NAVIGATE: Mode
MODE_SEARCH: Mode
MODE_HOLD: Mode
MODE_STOPPING: Mode
MODE_LANDED: Mode
MODE_FAULT: Mode
TASK_UNSPECIFIED: Task
TASK_TRACK: Task
TASK_NAVIGATE: Task
FALLBACK_NONE: Fallback
FALLBACK_PLAN_EXPIRED_BRAKE: Fallback
FALLBACK_HOLD_POSITION: Fallback
FALLBACK_ODOMETRY_FALSE_BRAKE: Fallback
FALLBACK_ODOMETRY_STALE_DESCEND: Fallback
FALLBACK_HAND_BACK: Fallback
ODOMETRY_FAULT_NONE: OdometryFault
ODOMETRY_FAULT_POSITION_JUMPED: OdometryFault
ODOMETRY_FAULT_POSITION_DISAGREES: OdometryFault
ODOMETRY_FAULT_VELOCITY_STEPPED: OdometryFault
ODOMETRY_FAULT_ATTITUDE_TURNED: OdometryFault
ODOMETRY_FAULT_HEADING_DISAGREES: OdometryFault
ODOMETRY_FAULT_FROZEN: OdometryFault
REJECTION_NONE: Rejection
REJECTION_OBJECTNESS: Rejection
REJECTION_GATE: Rejection
REJECTION_COST: Rejection
REJECTION_INVALID: Rejection
REJECTION_BLOCKED: Rejection
SEVERITY_UNSPECIFIED: Severity
SEVERITY_INFO: Severity
SEVERITY_WARNING: Severity
SEVERITY_ERROR: Severity

class Vec3(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Vec3f(_message.Message):
    __slots__ = ("x", "y", "z")
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    x: float
    y: float
    z: float
    def __init__(self, x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class Quat(_message.Message):
    __slots__ = ("w", "x", "y", "z")
    W_FIELD_NUMBER: _ClassVar[int]
    X_FIELD_NUMBER: _ClassVar[int]
    Y_FIELD_NUMBER: _ClassVar[int]
    Z_FIELD_NUMBER: _ClassVar[int]
    w: float
    x: float
    y: float
    z: float
    def __init__(self, w: _Optional[float] = ..., x: _Optional[float] = ..., y: _Optional[float] = ..., z: _Optional[float] = ...) -> None: ...

class StartRequest(_message.Message):
    __slots__ = ("command_id", "profile", "session", "stops")
    COMMAND_ID_FIELD_NUMBER: _ClassVar[int]
    PROFILE_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    STOPS_FIELD_NUMBER: _ClassVar[int]
    command_id: str
    profile: str
    session: int
    stops: int
    def __init__(self, command_id: _Optional[str] = ..., profile: _Optional[str] = ..., session: _Optional[int] = ..., stops: _Optional[int] = ...) -> None: ...

class StopRequest(_message.Message):
    __slots__ = ("command_id",)
    COMMAND_ID_FIELD_NUMBER: _ClassVar[int]
    command_id: str
    def __init__(self, command_id: _Optional[str] = ...) -> None: ...

class CommandReply(_message.Message):
    __slots__ = ("command_id", "accepted", "reason", "mode")
    COMMAND_ID_FIELD_NUMBER: _ClassVar[int]
    ACCEPTED_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    command_id: str
    accepted: bool
    reason: str
    mode: Mode
    def __init__(self, command_id: _Optional[str] = ..., accepted: _Optional[bool] = ..., reason: _Optional[str] = ..., mode: _Optional[_Union[Mode, str]] = ...) -> None: ...

class Candidate(_message.Message):
    __slots__ = ("end_pos_world", "end_vel_world", "end_acc_world", "cost", "objectness", "target_pos_world", "rejection", "added_obstacle", "added_mover", "added_target", "added_climbing")
    END_POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    END_VEL_WORLD_FIELD_NUMBER: _ClassVar[int]
    END_ACC_WORLD_FIELD_NUMBER: _ClassVar[int]
    COST_FIELD_NUMBER: _ClassVar[int]
    OBJECTNESS_FIELD_NUMBER: _ClassVar[int]
    TARGET_POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    REJECTION_FIELD_NUMBER: _ClassVar[int]
    ADDED_OBSTACLE_FIELD_NUMBER: _ClassVar[int]
    ADDED_MOVER_FIELD_NUMBER: _ClassVar[int]
    ADDED_TARGET_FIELD_NUMBER: _ClassVar[int]
    ADDED_CLIMBING_FIELD_NUMBER: _ClassVar[int]
    end_pos_world: Vec3f
    end_vel_world: Vec3f
    end_acc_world: Vec3f
    cost: float
    objectness: float
    target_pos_world: Vec3f
    rejection: Rejection
    added_obstacle: float
    added_mover: float
    added_target: float
    added_climbing: float
    def __init__(self, end_pos_world: _Optional[_Union[Vec3f, _Mapping]] = ..., end_vel_world: _Optional[_Union[Vec3f, _Mapping]] = ..., end_acc_world: _Optional[_Union[Vec3f, _Mapping]] = ..., cost: _Optional[float] = ..., objectness: _Optional[float] = ..., target_pos_world: _Optional[_Union[Vec3f, _Mapping]] = ..., rejection: _Optional[_Union[Rejection, str]] = ..., added_obstacle: _Optional[float] = ..., added_mover: _Optional[float] = ..., added_target: _Optional[float] = ..., added_climbing: _Optional[float] = ...) -> None: ...

class Plan(_message.Message):
    __slots__ = ("seq", "frame_ns", "ready_ns", "start_pos_world", "start_vel_world", "start_acc_world", "world_from_cam", "duration_s", "alpha", "candidates", "chosen")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    FRAME_NS_FIELD_NUMBER: _ClassVar[int]
    READY_NS_FIELD_NUMBER: _ClassVar[int]
    START_POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    START_VEL_WORLD_FIELD_NUMBER: _ClassVar[int]
    START_ACC_WORLD_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAM_FIELD_NUMBER: _ClassVar[int]
    DURATION_S_FIELD_NUMBER: _ClassVar[int]
    ALPHA_FIELD_NUMBER: _ClassVar[int]
    CANDIDATES_FIELD_NUMBER: _ClassVar[int]
    CHOSEN_FIELD_NUMBER: _ClassVar[int]
    seq: int
    frame_ns: int
    ready_ns: int
    start_pos_world: Vec3
    start_vel_world: Vec3
    start_acc_world: Vec3
    world_from_cam: Quat
    duration_s: float
    alpha: float
    candidates: _containers.RepeatedCompositeFieldContainer[Candidate]
    chosen: int
    def __init__(self, seq: _Optional[int] = ..., frame_ns: _Optional[int] = ..., ready_ns: _Optional[int] = ..., start_pos_world: _Optional[_Union[Vec3, _Mapping]] = ..., start_vel_world: _Optional[_Union[Vec3, _Mapping]] = ..., start_acc_world: _Optional[_Union[Vec3, _Mapping]] = ..., world_from_cam: _Optional[_Union[Quat, _Mapping]] = ..., duration_s: _Optional[float] = ..., alpha: _Optional[float] = ..., candidates: _Optional[_Iterable[_Union[Candidate, _Mapping]]] = ..., chosen: _Optional[int] = ...) -> None: ...

class ObstacleMap(_message.Message):
    __slots__ = ("seq", "stamp_ns", "origin_world", "voxel_m", "voxels", "depth")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    ORIGIN_WORLD_FIELD_NUMBER: _ClassVar[int]
    VOXEL_M_FIELD_NUMBER: _ClassVar[int]
    VOXELS_FIELD_NUMBER: _ClassVar[int]
    DEPTH_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    origin_world: Vec3
    voxel_m: float
    voxels: bytes
    depth: DepthBlocks
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., origin_world: _Optional[_Union[Vec3, _Mapping]] = ..., voxel_m: _Optional[float] = ..., voxels: _Optional[bytes] = ..., depth: _Optional[_Union[DepthBlocks, _Mapping]] = ...) -> None: ...

class DepthBlocks(_message.Message):
    __slots__ = ("frame_ns", "cam_world", "world_from_cam", "hfov_rad", "vfov_rad", "nearest_dm")
    FRAME_NS_FIELD_NUMBER: _ClassVar[int]
    CAM_WORLD_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_CAM_FIELD_NUMBER: _ClassVar[int]
    HFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    VFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    NEAREST_DM_FIELD_NUMBER: _ClassVar[int]
    frame_ns: int
    cam_world: Vec3
    world_from_cam: Quat
    hfov_rad: float
    vfov_rad: float
    nearest_dm: bytes
    def __init__(self, frame_ns: _Optional[int] = ..., cam_world: _Optional[_Union[Vec3, _Mapping]] = ..., world_from_cam: _Optional[_Union[Quat, _Mapping]] = ..., hfov_rad: _Optional[float] = ..., vfov_rad: _Optional[float] = ..., nearest_dm: _Optional[bytes] = ...) -> None: ...

class Control(_message.Message):
    __slots__ = ("seq", "stamp_ns", "mode", "fallback", "pos_world", "vel_world", "world_from_body", "acc_des_world", "acc_att_world", "acc_disturbance_world", "world_from_body_des", "thrust_n", "thrust_norm", "yaw_des_rad", "plan_seq", "plan_age_s", "hover_thrust", "attitude_lag_s", "odometry_fault", "odometry_doubt", "acc_meas_world", "disturbance_limit_mps2")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    FALLBACK_FIELD_NUMBER: _ClassVar[int]
    POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    VEL_WORLD_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_BODY_FIELD_NUMBER: _ClassVar[int]
    ACC_DES_WORLD_FIELD_NUMBER: _ClassVar[int]
    ACC_ATT_WORLD_FIELD_NUMBER: _ClassVar[int]
    ACC_DISTURBANCE_WORLD_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_BODY_DES_FIELD_NUMBER: _ClassVar[int]
    THRUST_N_FIELD_NUMBER: _ClassVar[int]
    THRUST_NORM_FIELD_NUMBER: _ClassVar[int]
    YAW_DES_RAD_FIELD_NUMBER: _ClassVar[int]
    PLAN_SEQ_FIELD_NUMBER: _ClassVar[int]
    PLAN_AGE_S_FIELD_NUMBER: _ClassVar[int]
    HOVER_THRUST_FIELD_NUMBER: _ClassVar[int]
    ATTITUDE_LAG_S_FIELD_NUMBER: _ClassVar[int]
    ODOMETRY_FAULT_FIELD_NUMBER: _ClassVar[int]
    ODOMETRY_DOUBT_FIELD_NUMBER: _ClassVar[int]
    ACC_MEAS_WORLD_FIELD_NUMBER: _ClassVar[int]
    DISTURBANCE_LIMIT_MPS2_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    mode: Mode
    fallback: Fallback
    pos_world: Vec3
    vel_world: Vec3
    world_from_body: Quat
    acc_des_world: Vec3
    acc_att_world: Vec3
    acc_disturbance_world: Vec3
    world_from_body_des: Quat
    thrust_n: float
    thrust_norm: float
    yaw_des_rad: float
    plan_seq: int
    plan_age_s: float
    hover_thrust: float
    attitude_lag_s: float
    odometry_fault: OdometryFault
    odometry_doubt: float
    acc_meas_world: Vec3
    disturbance_limit_mps2: float
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., mode: _Optional[_Union[Mode, str]] = ..., fallback: _Optional[_Union[Fallback, str]] = ..., pos_world: _Optional[_Union[Vec3, _Mapping]] = ..., vel_world: _Optional[_Union[Vec3, _Mapping]] = ..., world_from_body: _Optional[_Union[Quat, _Mapping]] = ..., acc_des_world: _Optional[_Union[Vec3, _Mapping]] = ..., acc_att_world: _Optional[_Union[Vec3, _Mapping]] = ..., acc_disturbance_world: _Optional[_Union[Vec3, _Mapping]] = ..., world_from_body_des: _Optional[_Union[Quat, _Mapping]] = ..., thrust_n: _Optional[float] = ..., thrust_norm: _Optional[float] = ..., yaw_des_rad: _Optional[float] = ..., plan_seq: _Optional[int] = ..., plan_age_s: _Optional[float] = ..., hover_thrust: _Optional[float] = ..., attitude_lag_s: _Optional[float] = ..., odometry_fault: _Optional[_Union[OdometryFault, str]] = ..., odometry_doubt: _Optional[float] = ..., acc_meas_world: _Optional[_Union[Vec3, _Mapping]] = ..., disturbance_limit_mps2: _Optional[float] = ...) -> None: ...

class Target(_message.Message):
    __slots__ = ("seq", "stamp_ns", "pos_world", "vel_world", "confirmed", "since_seen_s", "look", "covariance_upper")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    VEL_WORLD_FIELD_NUMBER: _ClassVar[int]
    CONFIRMED_FIELD_NUMBER: _ClassVar[int]
    SINCE_SEEN_S_FIELD_NUMBER: _ClassVar[int]
    LOOK_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_UPPER_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    pos_world: Vec3
    vel_world: Vec3
    confirmed: bool
    since_seen_s: float
    look: TargetLook
    covariance_upper: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., pos_world: _Optional[_Union[Vec3, _Mapping]] = ..., vel_world: _Optional[_Union[Vec3, _Mapping]] = ..., confirmed: _Optional[bool] = ..., since_seen_s: _Optional[float] = ..., look: _Optional[_Union[TargetLook, _Mapping]] = ..., covariance_upper: _Optional[_Iterable[float]] = ...) -> None: ...

class TargetLook(_message.Message):
    __slots__ = ("detections", "passed", "gate_sigmas", "innovation_world", "innovation_sigmas", "objectness", "rival_pos_world", "rival_objectness", "rival_needed")
    DETECTIONS_FIELD_NUMBER: _ClassVar[int]
    PASSED_FIELD_NUMBER: _ClassVar[int]
    GATE_SIGMAS_FIELD_NUMBER: _ClassVar[int]
    INNOVATION_WORLD_FIELD_NUMBER: _ClassVar[int]
    INNOVATION_SIGMAS_FIELD_NUMBER: _ClassVar[int]
    OBJECTNESS_FIELD_NUMBER: _ClassVar[int]
    RIVAL_POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    RIVAL_OBJECTNESS_FIELD_NUMBER: _ClassVar[int]
    RIVAL_NEEDED_FIELD_NUMBER: _ClassVar[int]
    detections: int
    passed: int
    gate_sigmas: float
    innovation_world: Vec3
    innovation_sigmas: float
    objectness: float
    rival_pos_world: Vec3
    rival_objectness: float
    rival_needed: float
    def __init__(self, detections: _Optional[int] = ..., passed: _Optional[int] = ..., gate_sigmas: _Optional[float] = ..., innovation_world: _Optional[_Union[Vec3, _Mapping]] = ..., innovation_sigmas: _Optional[float] = ..., objectness: _Optional[float] = ..., rival_pos_world: _Optional[_Union[Vec3, _Mapping]] = ..., rival_objectness: _Optional[float] = ..., rival_needed: _Optional[float] = ...) -> None: ...

class Check(_message.Message):
    __slots__ = ("name", "ok", "reason")
    NAME_FIELD_NUMBER: _ClassVar[int]
    OK_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    name: str
    ok: bool
    reason: str
    def __init__(self, name: _Optional[str] = ..., ok: _Optional[bool] = ..., reason: _Optional[str] = ...) -> None: ...

class Rate(_message.Message):
    __slots__ = ("name", "hz")
    NAME_FIELD_NUMBER: _ClassVar[int]
    HZ_FIELD_NUMBER: _ClassVar[int]
    name: str
    hz: float
    def __init__(self, name: _Optional[str] = ..., hz: _Optional[float] = ...) -> None: ...

class Latency(_message.Message):
    __slots__ = ("name", "p50_ms", "p99_ms", "max_ms", "count", "histogram")
    NAME_FIELD_NUMBER: _ClassVar[int]
    P50_MS_FIELD_NUMBER: _ClassVar[int]
    P99_MS_FIELD_NUMBER: _ClassVar[int]
    MAX_MS_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    HISTOGRAM_FIELD_NUMBER: _ClassVar[int]
    name: str
    p50_ms: float
    p99_ms: float
    max_ms: float
    count: int
    histogram: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, name: _Optional[str] = ..., p50_ms: _Optional[float] = ..., p99_ms: _Optional[float] = ..., max_ms: _Optional[float] = ..., count: _Optional[int] = ..., histogram: _Optional[_Iterable[int]] = ...) -> None: ...

class Drops(_message.Message):
    __slots__ = ("name", "count")
    NAME_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    name: str
    count: int
    def __init__(self, name: _Optional[str] = ..., count: _Optional[int] = ...) -> None: ...

class Health(_message.Message):
    __slots__ = ("seq", "stamp_ns", "mode", "ready", "checks", "rates", "latencies", "drops", "faults", "vehicle", "profile", "policy_sha256", "version", "battery_fraction", "log_path", "autopilot", "profiles", "protocol", "session", "events", "stops")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    READY_FIELD_NUMBER: _ClassVar[int]
    CHECKS_FIELD_NUMBER: _ClassVar[int]
    RATES_FIELD_NUMBER: _ClassVar[int]
    LATENCIES_FIELD_NUMBER: _ClassVar[int]
    DROPS_FIELD_NUMBER: _ClassVar[int]
    FAULTS_FIELD_NUMBER: _ClassVar[int]
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    PROFILE_FIELD_NUMBER: _ClassVar[int]
    POLICY_SHA256_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    BATTERY_FRACTION_FIELD_NUMBER: _ClassVar[int]
    LOG_PATH_FIELD_NUMBER: _ClassVar[int]
    AUTOPILOT_FIELD_NUMBER: _ClassVar[int]
    PROFILES_FIELD_NUMBER: _ClassVar[int]
    PROTOCOL_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    STOPS_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    mode: Mode
    ready: bool
    checks: _containers.RepeatedCompositeFieldContainer[Check]
    rates: _containers.RepeatedCompositeFieldContainer[Rate]
    latencies: _containers.RepeatedCompositeFieldContainer[Latency]
    drops: _containers.RepeatedCompositeFieldContainer[Drops]
    faults: _containers.RepeatedScalarFieldContainer[str]
    vehicle: str
    profile: str
    policy_sha256: str
    version: str
    battery_fraction: float
    log_path: str
    autopilot: str
    profiles: _containers.RepeatedScalarFieldContainer[str]
    protocol: int
    session: int
    events: int
    stops: int
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., mode: _Optional[_Union[Mode, str]] = ..., ready: _Optional[bool] = ..., checks: _Optional[_Iterable[_Union[Check, _Mapping]]] = ..., rates: _Optional[_Iterable[_Union[Rate, _Mapping]]] = ..., latencies: _Optional[_Iterable[_Union[Latency, _Mapping]]] = ..., drops: _Optional[_Iterable[_Union[Drops, _Mapping]]] = ..., faults: _Optional[_Iterable[str]] = ..., vehicle: _Optional[str] = ..., profile: _Optional[str] = ..., policy_sha256: _Optional[str] = ..., version: _Optional[str] = ..., battery_fraction: _Optional[float] = ..., log_path: _Optional[str] = ..., autopilot: _Optional[str] = ..., profiles: _Optional[_Iterable[str]] = ..., protocol: _Optional[int] = ..., session: _Optional[int] = ..., events: _Optional[int] = ..., stops: _Optional[int] = ...) -> None: ...

class Preview(_message.Message):
    __slots__ = ("seq", "stamp_ns", "width", "height", "jpeg")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    JPEG_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    width: int
    height: int
    jpeg: bytes
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., jpeg: _Optional[bytes] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("stamp_ns", "severity", "kind", "text", "seq")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SEVERITY_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    SEQ_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    severity: Severity
    kind: str
    text: str
    seq: int
    def __init__(self, stamp_ns: _Optional[int] = ..., severity: _Optional[_Union[Severity, str]] = ..., kind: _Optional[str] = ..., text: _Optional[str] = ..., seq: _Optional[int] = ...) -> None: ...

class MissedRequest(_message.Message):
    __slots__ = ("session", "after_event", "after_ns", "before_ns")
    SESSION_FIELD_NUMBER: _ClassVar[int]
    AFTER_EVENT_FIELD_NUMBER: _ClassVar[int]
    AFTER_NS_FIELD_NUMBER: _ClassVar[int]
    BEFORE_NS_FIELD_NUMBER: _ClassVar[int]
    session: int
    after_event: int
    after_ns: int
    before_ns: int
    def __init__(self, session: _Optional[int] = ..., after_event: _Optional[int] = ..., after_ns: _Optional[int] = ..., before_ns: _Optional[int] = ...) -> None: ...

class Missed(_message.Message):
    __slots__ = ("session", "events", "controls", "healths", "dropped_events", "dropped_samples", "more", "targets")
    SESSION_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    CONTROLS_FIELD_NUMBER: _ClassVar[int]
    HEALTHS_FIELD_NUMBER: _ClassVar[int]
    DROPPED_EVENTS_FIELD_NUMBER: _ClassVar[int]
    DROPPED_SAMPLES_FIELD_NUMBER: _ClassVar[int]
    MORE_FIELD_NUMBER: _ClassVar[int]
    TARGETS_FIELD_NUMBER: _ClassVar[int]
    session: int
    events: _containers.RepeatedCompositeFieldContainer[Event]
    controls: _containers.RepeatedCompositeFieldContainer[Control]
    healths: _containers.RepeatedCompositeFieldContainer[Health]
    dropped_events: int
    dropped_samples: int
    more: bool
    targets: _containers.RepeatedCompositeFieldContainer[Target]
    def __init__(self, session: _Optional[int] = ..., events: _Optional[_Iterable[_Union[Event, _Mapping]]] = ..., controls: _Optional[_Iterable[_Union[Control, _Mapping]]] = ..., healths: _Optional[_Iterable[_Union[Health, _Mapping]]] = ..., dropped_events: _Optional[int] = ..., dropped_samples: _Optional[int] = ..., more: _Optional[bool] = ..., targets: _Optional[_Iterable[_Union[Target, _Mapping]]] = ...) -> None: ...

class Rgbd(_message.Message):
    __slots__ = ("seq", "stamp_ns", "width", "height", "hfov_rad", "vfov_rad", "rgb", "depth_mm")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    HFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    VFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    RGB_FIELD_NUMBER: _ClassVar[int]
    DEPTH_MM_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    width: int
    height: int
    hfov_rad: float
    vfov_rad: float
    rgb: bytes
    depth_mm: bytes
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., hfov_rad: _Optional[float] = ..., vfov_rad: _Optional[float] = ..., rgb: _Optional[bytes] = ..., depth_mm: _Optional[bytes] = ...) -> None: ...

class Odometry(_message.Message):
    __slots__ = ("seq", "stamp_ns", "pos_world", "vel_world", "world_from_body", "ang_vel_body", "reset_counter")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    VEL_WORLD_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_BODY_FIELD_NUMBER: _ClassVar[int]
    ANG_VEL_BODY_FIELD_NUMBER: _ClassVar[int]
    RESET_COUNTER_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    pos_world: Vec3
    vel_world: Vec3
    world_from_body: Quat
    ang_vel_body: Vec3
    reset_counter: int
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., pos_world: _Optional[_Union[Vec3, _Mapping]] = ..., vel_world: _Optional[_Union[Vec3, _Mapping]] = ..., world_from_body: _Optional[_Union[Quat, _Mapping]] = ..., ang_vel_body: _Optional[_Union[Vec3, _Mapping]] = ..., reset_counter: _Optional[int] = ...) -> None: ...

class Imu(_message.Message):
    __slots__ = ("stamp_ns", "specific_force_body", "ang_vel_body")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SPECIFIC_FORCE_BODY_FIELD_NUMBER: _ClassVar[int]
    ANG_VEL_BODY_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    specific_force_body: Vec3
    ang_vel_body: Vec3
    def __init__(self, stamp_ns: _Optional[int] = ..., specific_force_body: _Optional[_Union[Vec3, _Mapping]] = ..., ang_vel_body: _Optional[_Union[Vec3, _Mapping]] = ...) -> None: ...

class LogHeader(_message.Message):
    __slots__ = ("vehicle", "vehicle_toml", "policy_sha256", "policy_contract_json", "version", "git_revision", "wall_time", "stamp_ns", "profile", "protocol", "tuning_toml")
    VEHICLE_FIELD_NUMBER: _ClassVar[int]
    VEHICLE_TOML_FIELD_NUMBER: _ClassVar[int]
    POLICY_SHA256_FIELD_NUMBER: _ClassVar[int]
    POLICY_CONTRACT_JSON_FIELD_NUMBER: _ClassVar[int]
    VERSION_FIELD_NUMBER: _ClassVar[int]
    GIT_REVISION_FIELD_NUMBER: _ClassVar[int]
    WALL_TIME_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    PROFILE_FIELD_NUMBER: _ClassVar[int]
    PROTOCOL_FIELD_NUMBER: _ClassVar[int]
    TUNING_TOML_FIELD_NUMBER: _ClassVar[int]
    vehicle: str
    vehicle_toml: str
    policy_sha256: str
    policy_contract_json: str
    version: str
    git_revision: str
    wall_time: str
    stamp_ns: int
    profile: str
    protocol: int
    tuning_toml: str
    def __init__(self, vehicle: _Optional[str] = ..., vehicle_toml: _Optional[str] = ..., policy_sha256: _Optional[str] = ..., policy_contract_json: _Optional[str] = ..., version: _Optional[str] = ..., git_revision: _Optional[str] = ..., wall_time: _Optional[str] = ..., stamp_ns: _Optional[int] = ..., profile: _Optional[str] = ..., protocol: _Optional[int] = ..., tuning_toml: _Optional[str] = ...) -> None: ...

class CompressedRgbd(_message.Message):
    __slots__ = ("seq", "stamp_ns", "width", "height", "hfov_rad", "vfov_rad", "rgb_png", "depth_png")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    WIDTH_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_FIELD_NUMBER: _ClassVar[int]
    HFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    VFOV_RAD_FIELD_NUMBER: _ClassVar[int]
    RGB_PNG_FIELD_NUMBER: _ClassVar[int]
    DEPTH_PNG_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    width: int
    height: int
    hfov_rad: float
    vfov_rad: float
    rgb_png: bytes
    depth_png: bytes
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., width: _Optional[int] = ..., height: _Optional[int] = ..., hfov_rad: _Optional[float] = ..., vfov_rad: _Optional[float] = ..., rgb_png: _Optional[bytes] = ..., depth_png: _Optional[bytes] = ...) -> None: ...

class PlannerInput(_message.Message):
    __slots__ = ("seq", "odometry", "acc_world", "speed_mps", "goal_world", "state", "prediction", "nearest_mm")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    ODOMETRY_FIELD_NUMBER: _ClassVar[int]
    ACC_WORLD_FIELD_NUMBER: _ClassVar[int]
    SPEED_MPS_FIELD_NUMBER: _ClassVar[int]
    GOAL_WORLD_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    PREDICTION_FIELD_NUMBER: _ClassVar[int]
    NEAREST_MM_FIELD_NUMBER: _ClassVar[int]
    seq: int
    odometry: Odometry
    acc_world: Vec3
    speed_mps: float
    goal_world: Vec3
    state: _containers.RepeatedScalarFieldContainer[float]
    prediction: _containers.RepeatedScalarFieldContainer[float]
    nearest_mm: bytes
    def __init__(self, seq: _Optional[int] = ..., odometry: _Optional[_Union[Odometry, _Mapping]] = ..., acc_world: _Optional[_Union[Vec3, _Mapping]] = ..., speed_mps: _Optional[float] = ..., goal_world: _Optional[_Union[Vec3, _Mapping]] = ..., state: _Optional[_Iterable[float]] = ..., prediction: _Optional[_Iterable[float]] = ..., nearest_mm: _Optional[bytes] = ...) -> None: ...

class ControllerInput(_message.Message):
    __slots__ = ("seq", "stamp_ns", "plan_seq", "connected", "armed", "offboard", "landed", "ready", "start", "stop", "hold", "resume", "odometry_ns", "battery", "imu_ns", "position")
    SEQ_FIELD_NUMBER: _ClassVar[int]
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    PLAN_SEQ_FIELD_NUMBER: _ClassVar[int]
    CONNECTED_FIELD_NUMBER: _ClassVar[int]
    ARMED_FIELD_NUMBER: _ClassVar[int]
    OFFBOARD_FIELD_NUMBER: _ClassVar[int]
    LANDED_FIELD_NUMBER: _ClassVar[int]
    READY_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    HOLD_FIELD_NUMBER: _ClassVar[int]
    RESUME_FIELD_NUMBER: _ClassVar[int]
    ODOMETRY_NS_FIELD_NUMBER: _ClassVar[int]
    BATTERY_FIELD_NUMBER: _ClassVar[int]
    IMU_NS_FIELD_NUMBER: _ClassVar[int]
    POSITION_FIELD_NUMBER: _ClassVar[int]
    seq: int
    stamp_ns: int
    plan_seq: int
    connected: bool
    armed: bool
    offboard: bool
    landed: bool
    ready: bool
    start: StartProfile
    stop: bool
    hold: bool
    resume: bool
    odometry_ns: int
    battery: float
    imu_ns: int
    position: bool
    def __init__(self, seq: _Optional[int] = ..., stamp_ns: _Optional[int] = ..., plan_seq: _Optional[int] = ..., connected: _Optional[bool] = ..., armed: _Optional[bool] = ..., offboard: _Optional[bool] = ..., landed: _Optional[bool] = ..., ready: _Optional[bool] = ..., start: _Optional[_Union[StartProfile, _Mapping]] = ..., stop: _Optional[bool] = ..., hold: _Optional[bool] = ..., resume: _Optional[bool] = ..., odometry_ns: _Optional[int] = ..., battery: _Optional[float] = ..., imu_ns: _Optional[int] = ..., position: _Optional[bool] = ...) -> None: ...

class StartProfile(_message.Message):
    __slots__ = ("task", "speed_mps", "height_m", "goal_m")
    TASK_FIELD_NUMBER: _ClassVar[int]
    SPEED_MPS_FIELD_NUMBER: _ClassVar[int]
    HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    GOAL_M_FIELD_NUMBER: _ClassVar[int]
    task: Task
    speed_mps: float
    height_m: float
    goal_m: Vec3
    def __init__(self, task: _Optional[_Union[Task, str]] = ..., speed_mps: _Optional[float] = ..., height_m: _Optional[float] = ..., goal_m: _Optional[_Union[Vec3, _Mapping]] = ...) -> None: ...

class CommandRecord(_message.Message):
    __slots__ = ("stamp_ns", "verb", "profile", "reply")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    VERB_FIELD_NUMBER: _ClassVar[int]
    PROFILE_FIELD_NUMBER: _ClassVar[int]
    REPLY_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    verb: str
    profile: str
    reply: CommandReply
    def __init__(self, stamp_ns: _Optional[int] = ..., verb: _Optional[str] = ..., profile: _Optional[str] = ..., reply: _Optional[_Union[CommandReply, _Mapping]] = ...) -> None: ...

class SimTruth(_message.Message):
    __slots__ = ("stamp_ns", "pos_world", "world_from_body", "vel_world", "target_pos_world", "target_vel_world", "clearance_m", "collisions", "target_distance_m", "target_path_m", "target_arrived", "target_visible", "moving", "acc_world", "goal_world")
    STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_BODY_FIELD_NUMBER: _ClassVar[int]
    VEL_WORLD_FIELD_NUMBER: _ClassVar[int]
    TARGET_POS_WORLD_FIELD_NUMBER: _ClassVar[int]
    TARGET_VEL_WORLD_FIELD_NUMBER: _ClassVar[int]
    CLEARANCE_M_FIELD_NUMBER: _ClassVar[int]
    COLLISIONS_FIELD_NUMBER: _ClassVar[int]
    TARGET_DISTANCE_M_FIELD_NUMBER: _ClassVar[int]
    TARGET_PATH_M_FIELD_NUMBER: _ClassVar[int]
    TARGET_ARRIVED_FIELD_NUMBER: _ClassVar[int]
    TARGET_VISIBLE_FIELD_NUMBER: _ClassVar[int]
    MOVING_FIELD_NUMBER: _ClassVar[int]
    ACC_WORLD_FIELD_NUMBER: _ClassVar[int]
    GOAL_WORLD_FIELD_NUMBER: _ClassVar[int]
    stamp_ns: int
    pos_world: Vec3
    world_from_body: Quat
    vel_world: Vec3
    target_pos_world: Vec3
    target_vel_world: Vec3
    clearance_m: float
    collisions: int
    target_distance_m: float
    target_path_m: float
    target_arrived: bool
    target_visible: bool
    moving: _containers.RepeatedCompositeFieldContainer[SimBox]
    acc_world: Vec3
    goal_world: Vec3
    def __init__(self, stamp_ns: _Optional[int] = ..., pos_world: _Optional[_Union[Vec3, _Mapping]] = ..., world_from_body: _Optional[_Union[Quat, _Mapping]] = ..., vel_world: _Optional[_Union[Vec3, _Mapping]] = ..., target_pos_world: _Optional[_Union[Vec3, _Mapping]] = ..., target_vel_world: _Optional[_Union[Vec3, _Mapping]] = ..., clearance_m: _Optional[float] = ..., collisions: _Optional[int] = ..., target_distance_m: _Optional[float] = ..., target_path_m: _Optional[float] = ..., target_arrived: _Optional[bool] = ..., target_visible: _Optional[bool] = ..., moving: _Optional[_Iterable[_Union[SimBox, _Mapping]]] = ..., acc_world: _Optional[_Union[Vec3, _Mapping]] = ..., goal_world: _Optional[_Union[Vec3, _Mapping]] = ...) -> None: ...

class SimTree(_message.Message):
    __slots__ = ("base_world", "top_world", "radius_m", "foliage_radius_m")
    BASE_WORLD_FIELD_NUMBER: _ClassVar[int]
    TOP_WORLD_FIELD_NUMBER: _ClassVar[int]
    RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    FOLIAGE_RADIUS_M_FIELD_NUMBER: _ClassVar[int]
    base_world: Vec3f
    top_world: Vec3f
    radius_m: float
    foliage_radius_m: float
    def __init__(self, base_world: _Optional[_Union[Vec3f, _Mapping]] = ..., top_world: _Optional[_Union[Vec3f, _Mapping]] = ..., radius_m: _Optional[float] = ..., foliage_radius_m: _Optional[float] = ...) -> None: ...

class SimBox(_message.Message):
    __slots__ = ("centre_world", "size_m", "yaw_rad")
    CENTRE_WORLD_FIELD_NUMBER: _ClassVar[int]
    SIZE_M_FIELD_NUMBER: _ClassVar[int]
    YAW_RAD_FIELD_NUMBER: _ClassVar[int]
    centre_world: Vec3f
    size_m: Vec3f
    yaw_rad: float
    def __init__(self, centre_world: _Optional[_Union[Vec3f, _Mapping]] = ..., size_m: _Optional[_Union[Vec3f, _Mapping]] = ..., yaw_rad: _Optional[float] = ...) -> None: ...

class SimWorldRequest(_message.Message):
    __slots__ = ("first",)
    FIRST_FIELD_NUMBER: _ClassVar[int]
    first: int
    def __init__(self, first: _Optional[int] = ...) -> None: ...

class SimWorld(_message.Message):
    __slots__ = ("trees", "seed", "spacing_m", "boxes", "items")
    TREES_FIELD_NUMBER: _ClassVar[int]
    SEED_FIELD_NUMBER: _ClassVar[int]
    SPACING_M_FIELD_NUMBER: _ClassVar[int]
    BOXES_FIELD_NUMBER: _ClassVar[int]
    ITEMS_FIELD_NUMBER: _ClassVar[int]
    trees: _containers.RepeatedCompositeFieldContainer[SimTree]
    seed: int
    spacing_m: float
    boxes: _containers.RepeatedCompositeFieldContainer[SimBox]
    items: int
    def __init__(self, trees: _Optional[_Iterable[_Union[SimTree, _Mapping]]] = ..., seed: _Optional[int] = ..., spacing_m: _Optional[float] = ..., boxes: _Optional[_Iterable[_Union[SimBox, _Mapping]]] = ..., items: _Optional[int] = ...) -> None: ...
