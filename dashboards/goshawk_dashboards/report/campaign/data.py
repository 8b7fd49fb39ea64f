"""A campaign as `goshawk-sim fly --json` writes it. Names, units and meaning are the file's own.

`cells` sum up the flights of one speed in one kind of place; `paths` hold where each flight went, and what stood about.
A file without paths (as the trainer keeps them) has figures of whole flights only. Shape suffix: S samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

import msgspec
import numpy as np

from goshawk_dashboards.state.views import Array

Pair = tuple[float, float]
Triple = tuple[float, float, float]
Outcome = Literal["success", "collision", "lost", "timeout", "too-close", "behind", "out-of-view", "slow"]
OUTCOMES: tuple[Outcome, ...] = get_args(Outcome)
"""How a flight can end, in the order of drawing."""
USUAL = ("goal", "planned", "policy")
"""Course, evader and pilot that are not worth a word where all cells have them."""


class CampaignError(Exception):
    """The file is no campaign; the message says why."""


@dataclass(frozen=True, kw_only=True)
class Quantiles:
    """Some places of a distribution; None: not in this one."""

    min: float | None = None
    p1: float | None = None
    p5: float | None = None
    p50: float | None = None
    p95: float | None = None


@dataclass(frozen=True, kw_only=True)
class MeanMax:
    """Of a quantity over the frames or the flown time."""

    mean: float
    max: float


@dataclass(frozen=True, kw_only=True)
class TargetError:
    """Of the target's estimate, m, across and along the line of sight."""

    lateral: Quantiles
    longitudinal: Quantiles


@dataclass(frozen=True, kw_only=True)
class Plane:
    """How often the target was in each square of half a metre about the vehicle: 24 rows forward, the nearest first.
    A row's 24 counts go from left to right, straight ahead is the middle. What is farther off counts at the border."""

    rows: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class FlightRow:
    """One flight in short."""

    trial: int
    outcome: Outcome
    contact: str | None
    flown_s: float
    end_pos_m: Triple
    end_distance_m: float
    unseen_s: float | None
    clearance_m: float | None
    in_view_fraction: float | None
    target_distance_m: MeanMax | None
    min_distance_to_target_m: float | None = None
    jerk_integral: float
    task_s: float | None = None
    """How long the task was flown."""
    flown_speed_mps: MeanMax
    modes: tuple[str, ...]

    @property
    def ending(self) -> str:
        """ "collision (trunk)"."""
        return f"{self.outcome} ({self.contact})" if self.contact else self.outcome


@dataclass(frozen=True, kw_only=True)
class Cell:
    """Flights of one speed in one kind of place."""

    cell: int = -1
    """Its place in the campaign; -1: that in the file."""
    pilot: str
    task: str
    speed_mps: float
    """What was asked for."""
    cruise_speed_mps: float | None = None
    """What was flown between the ends of the course; None: no flight came so far, or the file is older."""
    peak_speed_mps: float | None = None
    spacing_m: float
    world: str
    evader: str | None = None
    course: str | None = None
    length_m: float | None = None
    wind_mps: float
    moving: int
    trials: int
    successes: int
    success_interval: Pair
    reached: int | None = None
    """Successes by the lax rule; None: the file is older than the strict one, and its successes are these."""
    failures: dict[str, int]
    contacts: dict[str, int]
    clearance_m: Quantiles
    in_view_fraction: float | None
    target_distance_m: MeanMax | None
    min_distance_to_target_m: Quantiles | None = None
    target_error_m: TargetError | None
    jerk_integral: float
    jerk_integral_quantiles: Quantiles | None
    time_to_goal_s: Quantiles | None = None
    """Navigation, of the flights that reached the goal."""
    target_plane: Plane | None = None
    flown_speed_mps: MeanMax
    simulated_s: float
    flights: tuple[FlightRow, ...]

    @property
    def parts(self) -> list[str]:
        """Of its place: "4 m" between trees or "buildings", "goal" or "zigzag", who ran, "8 moving", who flew."""
        world = f"{self.spacing_m:g} m" if self.world == "forest" else self.world
        moving = f"{self.moving} moving" if self.moving else ""
        return [part for part in (world, self.course, self.evader, moving, self.pilot) if part]

    @property
    def place(self) -> str:
        """ "4 m, zigzag, 8 moving"; what is usual is not worth a word."""
        return ", ".join(part for part in self.parts if part not in USUAL)

    def count(self, outcome: str) -> int:
        """How many flights ended so."""
        return self.successes if outcome == "success" else self.failures.get(outcome.replace("-", "_"), 0)


@dataclass(frozen=True, kw_only=True)
class Mover:
    """A moving obstacle: between two places, and where it was at the end."""

    ends_m: tuple[Pair, Pair]
    at_m: Pair
    radius_m: float


@dataclass(frozen=True, kw_only=True)
class Map:
    """What stood about a path, cut at one height; world frame."""

    min_m: Pair
    max_m: Pair
    cut_m: float
    start_m: Pair
    goal_m: Pair | None
    solids: tuple[tuple[Pair, ...], ...]
    movers: tuple[Mover, ...]


@dataclass(frozen=True, kw_only=True)
class TargetPath:
    """The target at a path's samples."""

    pos_m: tuple[Triple, ...]
    pixel: tuple[Pair | None, ...]
    """Where the camera has its centre, also outside the image; None: behind it."""
    visible: tuple[bool, ...]


@dataclass(frozen=True, kw_only=True)
class FlightPath:
    """Where a flight went: evenly spaced samples from the task's beginning."""

    cell: int
    trial: int
    period_s: float
    pos_m: tuple[Triple, ...]
    speed_mps: tuple[float, ...]
    clearance_m: tuple[float, ...]
    target: TargetPath | None
    lateral_m: tuple[float, ...]
    longitudinal_m: tuple[float, ...]
    map: Map

    @property
    def pos_S3(self) -> Array:
        """The vehicle."""
        return np.array(self.pos_m, dtype=float).reshape(-1, 3)

    @property
    def target_S3(self) -> Array:
        """The target; no rows in navigation."""
        return np.array(self.target.pos_m if self.target else (), dtype=float).reshape(-1, 3)

    @property
    def distance_S(self) -> Array:
        """To the target; empty in navigation."""
        return np.linalg.norm(self.target_S3 - self.pos_S3, axis=1) if self.target else np.zeros(0)


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Processor time of one thread for a plan, ms."""

    mean: float
    p50: float
    p99: float


@dataclass(frozen=True, kw_only=True)
class Compute:
    """What a pilot's modules cost in all flights of a file."""

    pilot: str
    plans: int
    perception_ms: Cost
    mapping_ms: Cost
    planning_ms: Cost
    control_ms: Cost
    total_ms: Cost


@dataclass(frozen=True, kw_only=True)
class Timing:
    """How long the campaign took."""

    compute: tuple[Compute, ...] = ()


@dataclass(frozen=True, kw_only=True)
class File:
    """The file."""

    seed: int
    vehicle: str
    policy_sha256: str | None
    vehicle_sha256: str = ""
    flight_code_sha256: str = ""
    rule: str = ""
    """What a success is."""
    command: str = ""
    version: str = ""
    image_px: tuple[int, int] = (160, 96)
    speed_margin_mps: float
    height_m: float
    cells: tuple[Cell, ...]
    timing: Timing = field(default_factory=Timing)
    paths: tuple[FlightPath, ...] = field(default=())


@dataclass(frozen=True, kw_only=True)
class Pool:
    """A cell with its flights' paths."""

    cell: Cell
    number: int
    """As `--only` counts cells."""
    label: str
    """What tells it from the other cells: "3 m/s · 4 m"."""
    where: str
    """Its place without what all cells share, if anything is left then."""
    paths: dict[int, FlightPath]
    """By trial; empty if the file has none."""

    @cached_property
    def samples(self) -> dict[str, Array]:
        """Quantities at all samples of all its flights."""
        paths = self.paths.values()
        return {
            "distance": _joined([p.distance_S for p in paths]),
            "speed": _joined([p.speed_mps for p in paths]),
            "clearance": np.maximum(_joined([p.clearance_m for p in paths]), 0.0),
            "lateral": _joined([p.lateral_m for p in paths]),
            "longitudinal": _joined([p.longitudinal_m for p in paths]),
        }

    @property
    def pixels(self) -> list[Pair | None]:
        """Where the camera had the target, at all samples of all its flights."""
        return [pixel for p in self.paths.values() if p.target for pixel in p.target.pixel]


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A file, ready to be drawn."""

    name: str
    file: File
    pools: tuple[Pool, ...]

    @property
    def tracks(self) -> bool:
        """Whether a target was chased."""
        return any(pool.cell.task == "track" for pool in self.pools)

    def again(self, pool: Pool, trial: int) -> str:
        """The command that flies a flight again and logs it; empty if the file does not say."""
        command = self.file.command
        return command and f"{command} --only {pool.number}:{trial} --log flight-{pool.number}-{trial}"


def load(path: Path) -> Campaign:
    """Raises `CampaignError`."""
    try:
        file = msgspec.json.decode(path.read_bytes(), type=File)
    except OSError as error:
        raise CampaignError(f"{path}: {error.strerror}") from error
    except msgspec.MsgspecError as error:
        raise CampaignError(f"{path} is no campaign of goshawk-sim fly --json: {error}") from error
    if not file.cells:
        raise CampaignError(f"{path} has no cells: nothing was flown")
    common = set(file.cells[0].parts).intersection(*(cell.parts for cell in file.cells))
    pools: list[Pool] = []
    for place, cell in enumerate(file.cells):
        number = cell.cell if cell.cell >= 0 else place
        own = ", ".join(part for part in cell.parts if part not in common)
        label = f"{cell.speed_mps:g} m/s · {own}" if own else f"{cell.speed_mps:g} m/s"
        paths = {p.trial: p for p in file.paths if p.cell == number}
        pools.append(Pool(cell=cell, number=number, label=label, where=own or cell.place, paths=paths))
    return Campaign(name=path.stem, file=file, pools=tuple(pools))


def _joined(parts: Sequence[Array | tuple[float, ...]]) -> Array:
    return np.concatenate([np.asarray(part, dtype=float) for part in parts]) if parts else np.zeros(0)
