"""The training configuration: TOML files to frozen dataclasses, every field required, unknown ones refused.

Units are in the names; `configs/track.toml` says what the values mean.
"""

from __future__ import annotations

import dataclasses
import math
import tomllib
import typing
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, cast

from goshawk_train.errors import TrainerError


class ConfigError(TrainerError):
    """A configuration that cannot be used; the message names the field and what to do."""


STATE_SIZES = {"velocity": 3, "acceleration": 3, "up": 3, "aim": 3, "direction": 3, "agility": 1}
"""What the state input may hold: each is a vector in the camera frame, or a number. The paper's has the first two, and
in navigation the direction of the goal."""

TASK_STATES = ("aim", "direction", "agility")
"""Of these, what tells the task. The rest says how the camera moves and hangs."""

GOALS = ("aim", "direction")
"""Of these, what tells where to fly. A state has one; in tracking it may have none."""


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """The pinhole camera that the policy sees through; `tilt_rad` is its pitch on the vehicle, up positive."""

    width: int
    height: int
    hfov_rad: float
    vfov_rad: float
    tilt_rad: float

    @property
    def focal_px(self) -> float:
        """Focal length, px, the same on both axes."""
        return self.width / 2 / math.tan(self.hfov_rad / 2)


@dataclass(frozen=True, kw_only=True)
class DepthConfig:
    """What becomes of a depth image before the network."""

    min_m: float
    max_m: float
    fill_passes: int


@dataclass(frozen=True, kw_only=True)
class LatticeConfig:
    """The anchors (eq. 3) and how far a prediction may leave them (eq. 6)."""

    rows: int
    columns: int
    radius_m: float
    elevation_offset_rad: float
    azimuth_offset_rad: float

    @property
    def anchors(self) -> int:
        """Number of anchors."""
        return self.rows * self.columns


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """Largest speed and acceleration of training, at alpha = 1."""

    v_max_mps: float
    a_max_mps2: float


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """Size of the network; `channels` of the backbone's four stages (ResNet-18: 64, 128, 256, 512)."""

    state: tuple[str, ...]
    """What the state input holds, in the order of `STATE_SIZES`."""
    channels: tuple[int, int, int, int]
    head_channels: int
    target_depth_scale_m: float


@dataclass(frozen=True, kw_only=True)
class CostConfig:
    """Weights and scales of sections III-D and III-E."""

    samples: int
    jerk: float
    acceleration: float
    collision: float
    potential_distance_m: float
    potential_scale_m: float
    potential_rest: float
    clearance: float
    clearance_m: float
    clearance_agility: float
    clearance_spare: float
    ground: float
    ground_distance_m: float
    ground_scale_m: float
    feasibility: float
    goal_rule: Literal["aim", "paper"]
    """`aim`: every trajectory ends at the aim, and its distance is part of the cost. `paper`: the squared distance from
    the target, on positive anchors alone and not in the predicted cost; in navigation from the goal, on all."""
    goal: float
    progress: float
    idle: float
    trajectory_loss: float
    lambda_other: float
    lambda_negative: float
    cost_loss: float
    target_loss: float
    objectness_loss: float
    cost_label_max: float


@dataclass(frozen=True, kw_only=True)
class AssignConfig:
    """Which anchors hold the target."""

    positive_m: float
    ignored_m: float
    visible_min: float
    reach_px: float


@dataclass(frozen=True, kw_only=True)
class SamplingConfig:
    """Distribution of the sampled states, in units of v_max and a_max."""

    velocity_mean: float
    velocity_limit: float
    velocity_log_std: float
    velocity_min: float
    velocity_std: tuple[float, float]
    acceleration_std: tuple[float, float, float]
    norm_max: float
    aim_far: float
    aim_anywhere: float
    aim_yaw_std_rad: float
    aim_height_m: tuple[float, float]
    aim_height_std: float
    chase: float
    chase_spread_m: float
    chase_standoff_m: float
    chase_height_m: float
    agility_full: float
    agility_min: float
    agility_max: float


@dataclass(frozen=True, kw_only=True)
class AugmentConfig:
    """Strength of the image augmentation; the last four are probabilities or standard deviations of 0..1."""

    space: Literal["hsv", "yiq"]
    hue_rad: float
    saturation: float
    value: float
    noise: float
    blank_rgb: float
    blank_depth: float
    flip: float


@dataclass(frozen=True, kw_only=True)
class TrainingConfig:
    """The optimiser's schedule and the run's housekeeping."""

    batch: int
    states: int
    samples: int
    learning_rate: float
    warm_up_epochs: float
    final_fraction: float
    weight_decay: float
    ema: float
    gradient_norm_max: float
    checkpoint_minutes: float
    validate_minutes: float
    validate_frames: int
    threads: int
    bf16: bool


@dataclass(frozen=True, kw_only=True)
class Config:
    """Everything that decides a run, besides the data."""

    task: Literal["track", "navigate"]
    seed: int
    camera: CameraConfig
    depth: DepthConfig
    lattice: LatticeConfig
    motion: MotionConfig
    network: NetworkConfig
    costs: CostConfig
    assign: AssignConfig
    sampling: SamplingConfig
    augment: AugmentConfig
    training: TrainingConfig

    @property
    def duration_s(self) -> float:
        """T = 2 r / v_max, at alpha = 1."""
        return 2 * self.lattice.radius_m / self.motion.v_max_mps

    @property
    def state_sizes(self) -> dict[str, int]:
        """What the network's state input holds, in order."""
        return {name: STATE_SIZES[name] for name in self.network.state}

    @property
    def has_goal(self) -> bool:
        """The state tells where to fly, which navigation needs."""
        return any(name in GOALS for name in self.network.state)

    @property
    def reach_m(self) -> float:
        """No trajectory ends farther away; the length of an aim of 1."""
        return 2 * self.lattice.radius_m

    @property
    def channel_names(self) -> list[str]:
        """The network's outputs for an anchor, in order."""
        names = ["theta", "phi", "r", "vx", "vy", "vz", "ax", "ay", "az", "cost"]
        return names + (["objectness", "du", "dv", "distance"] if self.task == "track" else [])

    def validate(self) -> None:
        """Raise `ConfigError` where values contradict each other."""
        camera, lattice = self.camera, self.lattice
        if camera.width != 32 * lattice.columns or camera.height != 32 * lattice.rows:
            raise ConfigError(f"camera {camera.width}x{camera.height} is not 32 px for each cell of the lattice")
        vfov_rad = 2 * math.atan(camera.height / 2 / camera.focal_px)
        if abs(vfov_rad - camera.vfov_rad) > 1e-6:
            raise ConfigError(f"camera.vfov_rad must be {vfov_rad!r} for square pixels, not {camera.vfov_rad!r}")
        self._validate_state()
        positive = {
            "motion.v_max_mps": self.motion.v_max_mps,
            "motion.a_max_mps2": self.motion.a_max_mps2,
            "lattice.radius_m": lattice.radius_m,
            "network.channels": min(self.network.channels),
            "depth.max_m": self.depth.max_m - self.depth.min_m,
            "costs.samples": self.costs.samples,
            "costs.potential_scale_m": self.costs.potential_scale_m,
            "costs.ground_scale_m": self.costs.ground_scale_m,
            "sampling.agility_min": self.sampling.agility_min,
            "sampling.norm_max": self.sampling.norm_max,
            "training.batch": self.training.batch,
            "training.states": self.training.states,
            "training.samples": self.training.samples,
            "training.threads": self.training.threads,
            "training.validate_frames": self.training.validate_frames,
        }
        for name, value in positive.items():
            if not value > 0:
                raise ConfigError(f"{name} must be above 0")
        if self.sampling.agility_max < self.sampling.agility_min:
            raise ConfigError("sampling.agility_max must not be below sampling.agility_min")
        if not self.sampling.velocity_limit > self.sampling.velocity_mean:
            raise ConfigError("sampling.velocity_limit must be above sampling.velocity_mean")
        if self.seed < 0:
            raise ConfigError("seed must not be below 0")
        if self.assign.ignored_m < self.assign.positive_m:
            raise ConfigError("assign.ignored_m must not be below assign.positive_m")

    def _validate_state(self) -> None:
        state = self.network.state
        if state != tuple(name for name in STATE_SIZES if name in state) or state[:2] != ("velocity", "acceleration"):
            raise ConfigError(f"network.state must be velocity, acceleration and some of {list(STATE_SIZES)[2:]}, so")
        goals = sum(name in state for name in GOALS)
        if goals != 1 and not (goals == 0 and self.task == "track"):
            raise ConfigError("network.state must hold an aim or a direction; only tracking may have neither")
        if "aim" not in state and self.costs.goal_rule == "aim":
            raise ConfigError('network.state has no aim; costs.goal_rule must be "paper"')


def _convert(value: Any, wanted: Any, name: str) -> Any:
    if dataclasses.is_dataclass(wanted) and isinstance(wanted, type):
        if not isinstance(value, dict):
            raise ConfigError(f"{name} must be a table")
        return _build(wanted, cast("dict[str, Any]", value), name)
    origin = typing.get_origin(wanted)
    if origin is Literal:
        if value not in typing.get_args(wanted):
            raise ConfigError(f"{name} must be one of {typing.get_args(wanted)}, not {value!r}")
        return value
    if origin is tuple:
        args = typing.get_args(wanted)
        if args[-1] is Ellipsis:
            args = args[:1] * (len(cast("Sequence[Any]", value)) if isinstance(value, list | tuple) else 1)
        values = cast("Sequence[Any]", value) if isinstance(value, list | tuple) else ()
        if len(values) != len(args):
            raise ConfigError(f"{name} must be a list of {len(args)} numbers")
        return tuple(_convert(v, a, f"{name}[{i}]") for i, (v, a) in enumerate(zip(values, args, strict=True)))
    if wanted is float and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not wanted or (wanted is float and not math.isfinite(value)):
        raise ConfigError(f"{name} must be of type {getattr(wanted, '__name__', wanted)}, not {value!r}")
    return value


def _build(cls: Any, table: dict[str, Any], where: str) -> Any:
    hints = typing.get_type_hints(cls)
    prefix = f"{where}." if where else ""
    for key in table:
        if key not in hints:
            raise ConfigError(f"unknown field {prefix}{key}; remove it")
    for key in hints:
        if key not in table:
            raise ConfigError(f"field {prefix}{key} is missing; every field is required")
    return cls(**{key: _convert(table[key], hint, prefix + key) for key, hint in hints.items()})


def config_from_dict(table: dict[str, Any]) -> Config:
    """Build and validate a configuration; raises `ConfigError`."""
    config: Config = _build(Config, table, "")
    config.validate()
    return config


def config_to_dict(config: Config) -> dict[str, Any]:
    """The inverse of `config_from_dict`."""
    return dataclasses.asdict(config)


def load_config(path: Path) -> Config:
    """Read a TOML file; raises `ConfigError` naming the file and the field."""
    try:
        return config_from_dict(tomllib.loads(path.read_text()))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except (ConfigError, ValueError) as error:
        raise ConfigError(f"{path}: {error}") from error


def replace_training(config: Config, **changes: Any) -> Config:
    """A copy with some fields of `training` changed."""
    return dataclasses.replace(config, training=dataclasses.replace(config.training, **changes))
