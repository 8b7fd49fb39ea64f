"""Whether a vehicle is in the air, told from its controller's steps in their order.

A mode alone does not tell: a take-off begins, and a landing ends, on the ground. There the commanded thrust is no
estimate of the air, for the ground carries the vehicle.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.state.snapshot import FLYING, IN_AIR
from goshawk_dashboards.state.views import ControlView

LIFTED_M = 0.3
"""A vehicle this much above where it stood is in the air."""
UNCARRIED_MPS2 = -2.5
"""Attitude and thrust that give less than this upward carry no vehicle: it falls, or it stands."""
STILL_MPS = 0.2
"""What climbs and falls slower than this does not fall."""
TOOK_OFF = "→ Takeoff:"
"""What the vehicle's event of a take-off holds."""


def took_off(kind: str, text: str) -> bool:
    """Whether an event is a take-off's."""
    return kind == "mode" and TOOK_OFF in text


class Step(NamedTuple):
    """What a controller's step tells of it, in the world frame."""

    stamp_ns: int
    mode: int
    z_m: float
    climb_mps: float
    thrust_up_mps2: float
    """What attitude and thrust alone would give."""

    @staticmethod
    def of(control: ControlView) -> Step:
        """Of a step."""
        z_m, climb_mps = float(control.pos_world_3[2]), float(control.vel_world_3[2])
        return Step(control.stamp_ns, control.mode, z_m, climb_mps, float(control.acc_att_world_3[2]))

    @property
    def stands(self) -> bool:
        """Whether the ground must carry it."""
        return self.thrust_up_mps2 < UNCARRIED_MPS2 and abs(self.climb_mps) < STILL_MPS


class Ground:
    """Where one vehicle stands: before its take-off, and after its landing, which may be higher or lower."""

    def __init__(self) -> None:
        self.stood_z_m: float | None = None
        """Height of the ground that it took off from, in the world frame; None: it was not seen to stand."""
        self._told_ns: int | None = None
        """When it stood there, if that was told afterwards; None: it was seen."""
        self._landed_z_m: float | None = None
        self._last_ns: int | None = None

    def take(self, step: Step) -> None:
        """Goes on to a step. An earlier one is of a vehicle that was started anew."""
        if self._last_ns is not None and step.stamp_ns < self._last_ns:
            self.stood_z_m = self._told_ns = None
        self._last_ns = step.stamp_ns
        if not math.isfinite(step.z_m):
            return
        if step.mode not in IN_AIR:
            self.stood_z_m, self._told_ns = step.z_m, None
        elif self.stood_z_m is None and step.mode == pb.MODE_TAKEOFF:
            self.stood_z_m, self._told_ns = step.z_m, 0  # it may have risen already: what is told is better
        if step.mode != pb.MODE_STOPPING:
            self._landed_z_m = None
        elif step.stands:
            self._landed_z_m = step.z_m

    def tell(self, step: Step) -> None:
        """Hears afterwards of an earlier step: the newest on the ground counts, unless it was seen to stand."""
        if step.mode in IN_AIR or not math.isfinite(step.z_m):
            return
        if self.stood_z_m is None or (self._told_ns is not None and step.stamp_ns > self._told_ns):
            self.stood_z_m, self._told_ns = step.z_m, step.stamp_ns

    def airborne(self, step: Step) -> bool:
        """Whether a vehicle has left the ground, and has not come back to it."""
        rise_m = math.inf if self.stood_z_m is None else step.z_m - self.stood_z_m
        if step.mode == pb.MODE_TAKEOFF:
            return rise_m > LIFTED_M
        if step.mode == pb.MODE_FAULT:
            return abs(rise_m) > LIFTED_M  # somebody else flies it: lower is no ground that it is known to stand on
        if step.mode == pb.MODE_STOPPING:
            landed_z_m = step.z_m if step.stands else self._landed_z_m
            return landed_z_m is None or abs(step.z_m - landed_z_m) > LIFTED_M
        return step.mode in FLYING
