"""What a demonstration flight amounted to: figures from the simulator's truth, and the verdict. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from goshawk_dashboards.state import words
from goshawk_dashboards.state.views import HealthView, TruthView
from goshawk_proto import goshawk_pb2 as pb

MAX_TARGET_DISTANCE_M = 12.0
"""When the target arrives the vehicle must be within this of it …"""
MAX_UNSEEN_S = 1.0
"""… and must have had it in view within this."""
GOAL_RADIUS_M = 2.0
"""A navigation arrives this near to its goal, level, as the simulator's campaigns have it."""
TRACKING = (pb.MODE_TRACK, pb.MODE_SEARCH, pb.MODE_HOLD)
NAVIGATING = (pb.MODE_NAVIGATE, pb.MODE_HOLD)
AIRBORNE = (pb.MODE_TAKEOFF, *TRACKING, pb.MODE_NAVIGATE, pb.MODE_STOPPING)
DOWN = (pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE)


@dataclass(frozen=True, kw_only=True)
class Summary:
    """The flight in figures. None: it never came to that, or it is another task's."""

    succeeded: bool
    problems: tuple[str, ...]
    """Each reason why it did not succeed, one line."""
    tracked_s: float
    """From the task's first mode to the arrival (or to the last sample)."""
    target_path_m: float
    vehicle_path_m: float
    mean_speed_mps: float | None
    max_speed_mps: float | None
    min_clearance_m: float | None
    collisions: int
    in_view_fraction: float | None
    target_distance_median_m: float | None
    target_distance_max_m: float | None
    target_distance_end_m: float | None
    goal_distance_end_m: float | None
    planner_hz: float | None
    controller_hz: float | None
    log_path: str


class FlightRecord:
    """Gathers one flight. Samples come in order; times are the truth's own stamps."""

    def __init__(self, distance_m: float, *, navigates: bool = False) -> None:
        """``distance_m`` is the way that the target is to run."""
        self.distance_m = distance_m
        self.navigates = navigates
        self.modes: list[pb.Mode] = []
        """Each mode in the order seen, without repeats in a row."""
        self.task: list[tuple[int, float, float, bool, float]] = []
        """While it did its task: stamp, speed, distance to target or goal, target in view, clearance."""
        self.arrived_ns: int | None = None
        self._collisions_before: int | None = None
        self._collisions = 0
        self._unseen_at_end_s: float | None = None
        self._last_seen_ns: int | None = None
        self._path_m = 0.0
        self._vehicle_path_m = 0.0
        self._last_pos_3: np.ndarray | None = None
        self._health: HealthView | None = None
        self.log_path = ""

    def saw_mode(self, mode: pb.Mode) -> None:
        """The vehicle's mode, as often as it is heard."""
        if not self.modes or self.modes[-1] != mode:
            self.modes.append(mode)

    def saw_health(self, health: HealthView) -> None:
        """A heartbeat; the rates that count are those of the task."""
        self.saw_mode(health.mode)
        self.log_path = health.log_path or self.log_path
        if health.mode in self._modes_of_task and self.arrived_ns is None:
            self._health = health

    def saw_truth(self, truth: TruthView) -> None:
        """A sample of the simulator's truth."""
        mode = self.modes[-1] if self.modes else pb.MODE_UNSPECIFIED
        if mode not in AIRBORNE:
            return
        if self._collisions_before is None:
            self._collisions_before = truth.collisions
        self._collisions = truth.collisions - self._collisions_before
        if mode not in self._modes_of_task or self.arrived_ns is not None:
            return
        if self._last_pos_3 is not None:
            self._vehicle_path_m += float(np.linalg.norm(truth.pos_world_3 - self._last_pos_3))
        self._last_pos_3 = truth.pos_world_3
        if truth.target_visible:
            self._last_seen_ns = truth.stamp_ns
        self._path_m = truth.target_path_m
        away_m = goal_distance_m(truth) if self.navigates else truth.target_distance_m
        speed_mps = float(np.linalg.norm(truth.vel_world_3))
        self.task.append((truth.stamp_ns, speed_mps, away_m, truth.target_visible, truth.clearance_m))
        ran = truth.target_arrived or truth.target_path_m >= self.distance_m
        if away_m <= GOAL_RADIUS_M if self.navigates else ran:
            self.arrived_ns = truth.stamp_ns
            seen = self._last_seen_ns
            self._unseen_at_end_s = None if seen is None else (truth.stamp_ns - seen) * 1e-9

    @property
    def arrived(self) -> bool:
        """Whether the target has run its distance while it was tracked, or the vehicle is at its goal."""
        return self.arrived_ns is not None

    @property
    def collided(self) -> bool:
        """Whether the vehicle hit anything since it took off."""
        return self._collisions > 0

    @property
    def _modes_of_task(self) -> tuple[pb.Mode, ...]:
        return NAVIGATING if self.navigates else TRACKING

    def problems(self) -> tuple[str, ...]:
        """Why the flight is not a success, or nothing."""
        found: list[str] = []
        if pb.MODE_TAKEOFF not in self.modes and not any(m in self._modes_of_task for m in self.modes):
            return ("it never took off",)
        if pb.MODE_FAULT in self.modes:
            found.append("the vehicle reported a fault and handed back")
        if self.collided:
            found.append(f"it collided {self._collisions} time{'s' if self._collisions != 1 else ''}")
        found += self._navigation_problems() if self.navigates else self._chase_problems()
        if not self.modes or self.modes[-1] not in DOWN:
            last = words.mode(self.modes[-1]) if self.modes else "unknown"
            found.append(f"it did not land: its last mode was {last}")
        return tuple(found)

    def _navigation_problems(self) -> list[str]:
        if self.arrived:
            return []
        return [f"the goal was {self.task[-1][2]:.0f} m away at the end" if self.task else "it never navigated"]

    def _chase_problems(self) -> list[str]:
        if not self.task:
            return ["it never tracked the target"]
        if not self.arrived:
            return [f"the target had run {self._path_m:.0f} of {self.distance_m:.0f} m when the flight ended"]
        found: list[str] = []
        end_m = self.task[-1][2]
        if end_m > MAX_TARGET_DISTANCE_M:
            found.append(f"the target arrived {end_m:.1f} m away, more than {MAX_TARGET_DISTANCE_M:.0f} m")
        if self._unseen_at_end_s is None:
            found.append("the target was never in view")
        elif self._unseen_at_end_s > MAX_UNSEEN_S:
            found.append(f"the target had not been in view for {self._unseen_at_end_s:.1f} s when it arrived")
        return found

    def summary(self, extra_problems: tuple[str, ...] = ()) -> Summary:
        """The figures and the verdict; ``extra_problems`` come from outside the flight (a process that died)."""
        problems = extra_problems + self.problems()
        rows = np.array([row[1:] for row in self.task], dtype=np.float64).reshape(-1, 4)
        some = len(rows) > 0
        chased = some and not self.navigates
        rates = dict(self._health.rates_hz) if self._health is not None else {}
        return Summary(
            succeeded=not problems,
            problems=problems,
            tracked_s=(self.task[-1][0] - self.task[0][0]) * 1e-9 if some else 0.0,
            target_path_m=self._path_m,
            vehicle_path_m=self._vehicle_path_m,
            mean_speed_mps=float(rows[:, 0].mean()) if some else None,
            max_speed_mps=float(rows[:, 0].max()) if some else None,
            min_clearance_m=float(rows[:, 3].min()) if some else None,
            collisions=self._collisions,
            in_view_fraction=float(rows[:, 2].mean()) if chased else None,
            target_distance_median_m=float(np.median(rows[:, 1])) if chased else None,
            target_distance_max_m=float(rows[:, 1].max()) if chased else None,
            target_distance_end_m=float(rows[-1, 1]) if chased else None,
            goal_distance_end_m=float(rows[-1, 1]) if some and self.navigates else None,
            planner_hz=rates.get("planner"),
            controller_hz=rates.get("controller"),
            log_path=self.log_path,
        )


def goal_distance_m(truth: TruthView) -> float:
    """Level distance to the goal; infinite while the simulator tells none."""
    if truth.goal_world_3 is None:
        return float("inf")
    return float(np.linalg.norm((truth.goal_world_3 - truth.pos_world_3)[:2]))
