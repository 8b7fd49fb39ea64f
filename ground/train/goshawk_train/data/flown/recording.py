"""A flight log as the trainer needs it: where the camera was at each image, and what the policy said of it.

Shape letters: F images, N candidates, H, W image rows and columns, 3 a world vector (ENU, m), 4 a quaternion.
"""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from goshawk_dashboards.log.flight import Flight, LogError
from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.state.views import PlanView
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from goshawk_train.data import DataError
from goshawk_train.data.flown.smooth import smooth
from goshawk_train.data.foreign.resample import OURS, Intrinsics, Resampler
from goshawk_train.model import geometry

F64 = NDArray[np.float64]
Picture = TypeVar("Picture", bound=NDArray[Any])

_APART_S = 0.1
"""An image needs odometry so near, on both sides: a log may have gaps."""
_ACROSS_M, _LONGEST_S = 60.0, 120.0
"""A scene's positions lie in a box of this length, and it is no longer: its map and images are held in memory."""
_POSITION_M, _VELOCITY_MPS, _ACCELERATION = 0.02, 0.05, 20.0
"""How far the odometry is trusted from one sample to the next, and how the vehicle's velocity walks, m²/s³."""
FIELD_OF_VIEW = 0.02
"""Relative: the vehicle flies with a camera that sees so much more or less (`air/policy/src/preprocess.rs`)."""
_SAME_RAD = 2e-3
"""An image that is nearer to our view is taken as it is: resampling would blur more than it mends."""
_FLOWN = ("tracking", "lost", "search", "navigation", "hold")
_CLIMBED_M = 0.5
"""Of a take-off, what is so high above its begin is flown: on the ground a policy sees what it was never shown."""


@dataclass(frozen=True, kw_only=True)
class Mount:
    """Where the camera sits on the vehicle, as its file says."""

    tilt_rad: float
    position_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The images that were taken in flight and have a pose. Decoded when asked for."""

    flight: Flight
    mount: Mount
    contract: dict[str, Any]
    """What the policy that flew says of itself; empty if none did."""
    index_F: NDArray[np.int64]
    """Of each image among the log's."""
    stamp_F: NDArray[np.int64]
    """Its capture, ns."""
    time_F: F64
    """The same in seconds since the log's begin."""
    pos_world_F3: F64
    """Of the lens."""
    world_from_cam_F33: F64
    stretch_F: NDArray[np.int64]
    """Number of the stretch of flight, which becomes a scene: without a jump of the odometry, and not too long."""

    @property
    def name(self) -> str:
        """The log's, without its folder."""
        return self.flight.path.name

    @property
    def task(self) -> str:
        """Whether the policy that flew looks for a target: "track" if it does."""
        return str(self.contract.get("task", "navigate"))

    @property
    def cost_scale(self) -> float:
        """How far apart that policy's costs are."""
        return float(self.contract.get("cost_scale", 1.0))

    def rgb(self, frame: int) -> NDArray[np.uint8]:
        """Colour [H, W, 3] of our view; raises `DataError` if the picture is broken."""
        view = self._view(frame)
        seen = self._whole(frame, view and view.rgb_HW3())
        ours = view and _onto_ours(view.hfov_rad, view.vfov_rad)
        return ours.rgb(seen) if ours else seen

    def depth(self, frame: int) -> NDArray[np.uint16]:
        """Depth [H, W] of our view in mm; raises `DataError` if the picture is broken."""
        view = self._view(frame)
        seen = np.rint(self._whole(frame, view and view.depth_m_HW()) * 1000).astype(np.uint16)
        ours = view and _onto_ours(view.hfov_rad, view.vfov_rad)
        return ours.depth(seen) if ours else seen

    def _view(self, frame: int) -> FrameView | None:
        return self.flight.frame_at(self.flight.time_s("rgbd", int(self.index_F[frame])))

    def _whole(self, frame: int, picture: Picture | None) -> Picture:
        if picture is None:
            at = f"the image at {self.time_F[frame]:.2f} s"
            raise DataError(f"{self.flight.path}: {at} is broken; `goshawk review` shows the log")
        return picture

    @cached_property
    def plans(self) -> dict[int, PlanView]:
        """The plan of each image that was answered."""
        places = {int(stamp): frame for frame, stamp in enumerate(self.stamp_F)}
        told = (self.flight.plan(number) for number in range(self.flight.count("plan")))
        return {places[plan.frame_ns]: plan for plan in told if plan is not None and plan.frame_ns in places}


def read(path: Path) -> Recording:
    """Open a log; raises `DataError`, one line, if it is none that can be trained on."""
    try:
        flight = Flight.open(path)
    except LogError as error:
        raise DataError(str(error)) from error
    if not flight.count("rgbd"):
        raise DataError(f"{path} holds no images: fly with a recorder that keeps them")
    mount = _mount(flight)
    _check_camera(flight)
    stamps = cast("NDArray[np.int64]", flight.columns("rgbd", ["stamp_ns"])["stamp_ns"])
    if len(stamps) != flight.count("rgbd"):
        raise DataError(f"{path}: some of its images do not decode; write it anew with `goshawk recover`")
    index_F, pos_F3, attitude_F, jumps_F = _poses(flight, stamps)
    if not len(index_F):
        raise DataError(f"{path} holds no odometry around its images: it cannot be said where they were taken")
    times_F = (stamps[index_F] - flight.start_ns).astype(np.float64) * 1e-9
    flown = _flown(flight, times_F, pos_F3[:, 2])
    if not flown.any():
        raise DataError(f"{path} holds no image that was taken in flight")
    index_F, jumps_F = index_F[flown], jumps_F[flown]
    attitude_F = cast("Any", attitude_F)[flown]
    pos_F3 = pos_F3[flown] + attitude_F.apply(np.array(mount.position_m))
    return Recording(
        flight=flight,
        mount=mount,
        contract=_contract(flight),
        index_F=index_F,
        stamp_F=stamps[index_F],
        time_F=times_F[flown],
        pos_world_F3=pos_F3,
        world_from_cam_F33=attitude_F.as_matrix() @ geometry.rotation_y(-mount.tilt_rad),
        stretch_F=_stretches(times_F[flown], pos_F3, jumps_F),
    )


def _mount(flight: Flight) -> Mount:
    try:
        camera = tomllib.loads(flight.header.vehicle_toml)["camera"]
        x, y, z = (float(value) for value in camera["position_m"])
        return Mount(tilt_rad=math.radians(float(camera["tilt_deg"])), position_m=(x, y, z))
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise DataError(
            f"{flight.path} holds no vehicle file with a camera: what its poses are of is unknown"
        ) from error


def _contract(flight: Flight) -> dict[str, Any]:
    """What the policy that flew says of itself; empty if none did."""
    try:
        found = json.loads(flight.header.policy_contract_json or "{}")
    except ValueError as error:
        raise DataError(f"{flight.path}: its policy's contract is not JSON") from error
    return cast("dict[str, Any]", found) if isinstance(found, dict) else {}


def _check_camera(flight: Flight) -> None:
    """The images must be of what the trainer's policies see, as far as the vehicle flies with them."""
    seen = flight.columns("rgbd", ["width", "height", "hfov_rad", "vfov_rad"])
    for width, height, hfov, vfov in zip(*(seen[n] for n in ("width", "height", "hfov_rad", "vfov_rad")), strict=True):
        size = (int(width), int(height)) == (OURS.width, OURS.height)
        if size and max(abs(hfov / OURS.hfov_rad - 1), abs(vfov / OURS.vfov_rad - 1)) <= FIELD_OF_VIEW:
            continue
        is_, must = (
            f"{w:g} x {h:g} at {math.degrees(a):.1f} x {math.degrees(b):.1f} deg"
            for w, h, a, b in (
                (width, height, hfov, vfov),
                (OURS.width, OURS.height, OURS.hfov_rad, OURS.vfov_rad),
            )
        )
        raise DataError(f"{flight.path}: its images are {is_}, the policies see {must}; such a camera cannot be learnt")


@lru_cache
def _onto_ours(hfov_rad: float, vfov_rad: float) -> Resampler | None:
    """To our view from that of a lens that sees a little more or less; None: it sees the same.

    A data set has one view, so its labels are right only for images of that view.
    """
    if max(abs(hfov_rad - OURS.hfov_rad), abs(vfov_rad - OURS.vfov_rad)) <= _SAME_RAD:
        return None
    half_u, half_v = OURS.width / 2, OURS.height / 2
    focal_u, focal_v = half_u / math.tan(hfov_rad / 2), half_v / math.tan(vfov_rad / 2)
    return Resampler(OURS.width, OURS.height, Intrinsics(fx=focal_u, fy=focal_v, cx=half_u, cy=half_v))


def _poses(flight: Flight, stamps_F: NDArray[np.int64]) -> tuple[NDArray[np.int64], F64, Rotation, NDArray[np.int64]]:
    """Which images have a pose; the body's position, attitude and count of jumps at these."""
    fields = ("stamp_ns", "pos_world", "vel_world", "world_from_body", "reset_counter")
    odometry = flight.columns("odometry", fields)
    good = (
        np.isfinite(np.column_stack([odometry[n] for n in fields[1:4]])).all(axis=1) if len(odometry) else np.zeros(0)
    )
    stamp, which = np.unique(odometry["stamp_ns"][good.astype(bool)], return_index=True)
    table = {name: odometry[name][good.astype(bool)][which] for name in fields}
    after = np.searchsorted(stamp, stamps_F)
    inside = (after > 0) & (after < len(stamp))
    high = np.where(inside, after, 0)
    low = np.maximum(high - 1, 0)
    if not inside.any():
        return np.zeros(0, dtype=np.int64), np.zeros((0, 3)), Rotation.identity(0), np.zeros(0, dtype=np.int64)
    jumps = table["reset_counter"]
    inside &= (stamp[high] - stamp[low] < 2e9 * _APART_S) & (jumps[high] == jumps[low])
    index = np.flatnonzero(inside)
    seconds, asked = ((s - stamp[0]) * 1e-9 for s in (stamp, stamps_F[index]))
    pos = np.zeros((len(index), 3))
    frame_jumps = jumps[high[index]]
    for jump in np.unique(frame_jumps):
        of, at = jumps == jump, frame_jumps == jump
        pos[at] = _positions(seconds[of], table["pos_world"][of], table["vel_world"][of], asked[at])
    attitude = Slerp(seconds, Rotation.from_quat(np.roll(table["world_from_body"], -1, axis=1)))(asked)
    return index, pos, attitude, frame_jumps.astype(np.int64)


def _positions(times_T: F64, pos_T3: F64, vel_T3: F64, asked_F: F64) -> F64:
    """Smoothed positions at some times."""
    all_T = np.concatenate([times_T, asked_F])
    order = np.argsort(all_T, kind="stable")
    value = np.concatenate([np.column_stack([pos_T3, vel_T3]), np.zeros((len(asked_F), 6))])[order]
    measured = np.concatenate([np.ones(len(times_T), dtype=bool), np.zeros(len(asked_F), dtype=bool)])[order]
    noise = np.broadcast_to(np.diag([_POSITION_M**2] * 3 + [_VELOCITY_MPS**2] * 3), (len(all_T), 6, 6))
    smoothed = smooth(all_T[order], measured, value, noise, acceleration=_ACCELERATION)
    return smoothed.pos_T3[~measured]


def _flown(flight: Flight, time_F: F64, height_F: F64) -> NDArray[np.bool_]:
    """Which images were taken in flight; a landing is none, as it ends on the ground."""
    flown = np.zeros(len(time_F), dtype=bool)
    for phase in flight.phases:
        inside = (time_F >= phase.start_s) & (time_F < phase.end_s)
        if phase.name in _FLOWN:
            flown |= inside
        elif phase.name == "take-off" and inside.any():
            flown |= inside & (height_F > height_F[inside][0] + _CLIMBED_M)
    return flown


def _stretches(time_F: F64, pos_F3: F64, jumps_F: NDArray[np.int64]) -> NDArray[np.int64]:
    """The stretch of each image: a new one begins at a jump, and where the last would grow too large."""
    out = np.zeros(len(pos_F3), dtype=np.int64)
    low = high = pos_F3[0]
    begin = time_F[0]
    for f in range(1, len(pos_F3)):
        low, high = np.minimum(low, pos_F3[f]), np.maximum(high, pos_F3[f])
        large = (high - low)[:2].max() > _ACROSS_M or time_F[f] - begin > _LONGEST_S
        new = jumps_F[f] != jumps_F[f - 1] or large
        out[f] = out[f - 1] + new
        if new:
            low, high, begin = pos_F3[f], pos_F3[f], time_F[f]
    return out
