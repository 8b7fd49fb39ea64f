"""Where the target was at each image: the detections of a flight, smoothed backwards and forwards.

A detection is where the policy saw the target; how far, depth says better. The onboard filter believed some of them.
From those a first track is smoothed, and whatever agrees with that joins it: so detections from before the filter was
sure count as well, and images before the first one get a label. Where the track is too doubtful, or depth contradicts
it, there is no label at all, which is something else than no target.

Shape letters: F images, 3 a world vector (ENU, m), 33 a covariance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from goshawk_dashboards.state.views import PlanView
from numpy.typing import NDArray

from goshawk_train.data.check.poses import shares_around
from goshawk_train.data.flown.recording import Recording
from goshawk_train.data.flown.smooth import Smoothed, smooth
from goshawk_train.data.foreign.resample import OURS
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

TRUSTED_M = 0.35
"""A position is a label up to this standard deviation in its most doubtful direction."""
_DETECTED = 0.5
_SEED_M = 1.5
"""The first track is of detections so near to what the onboard filter held, once confirmed and seen just now."""
_JUST_NOW_S = 0.05
_ACCELERATION = 8.0
"""How a runner's velocity walks, m²/s³."""
_LATERAL_M, _RANGE_SHARE, _RANGE_DEPTH_M = 0.12, 0.12, 0.15
"""Standard deviations of a detection: across the line of sight; along it by the network, by depth."""
_SURFACE_M = 0.1
"""The target's centre lies so far behind the surface that the camera sees."""
_TRUNK_PX, _TRUNK_ROWS_PX, _MATCH_M, _PIXELS = 1, 3, 1.5, 4
_GATE = 16.0
"""Squared Mahalanobis distance within which a detection joins the track, about 99.9 % of true ones."""
_ROUNDS = 3
_EDGE_PX = 8.0
_CONTRADICTED = 0.6


@dataclass(frozen=True, kw_only=True)
class Track:
    """The target at each of some images."""

    pos_world_F3: F64
    known_F: NDArray[np.bool_]
    """Whether there is a label: the position is trusted, and depth does not contradict it."""
    visible_F: F64
    """Share that is seen, where known: 0 also out of view."""
    near_F: NDArray[np.bool_]
    """Whether the position is good enough to keep the target out of the map."""


def follow(recording: Recording, frames_F: NDArray[np.int64], depth_FHW: NDArray[np.uint16]) -> Track:
    """The target along a stretch; `depth_FHW` is of its images."""
    count = len(frames_F)
    place = {int(frame): f for f, frame in enumerate(frames_F)}
    value, noise = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    detected = np.zeros(count, dtype=bool)
    for frame, plan in recording.plans.items():
        if frame in place and plan.target_pos_world_N3 is not None and plan.objectness_N.max() >= _DETECTED:
            f = place[frame]
            best = int(plan.objectness_N.argmax())
            lens = recording.pos_world_F3[frame]
            seen = plan.target_pos_world_N3[best] + _own_shift(recording, frame, plan)
            value[f], noise[f] = _measured(seen, lens, recording.world_from_cam_F33[frame], depth_FHW[f])
            detected[f] = True
    joined = detected & _believed(recording, frames_F, value)
    nothing = np.zeros(count, dtype=bool)
    if not joined.any():
        unknown = np.full(count, np.nan)
        return Track(pos_world_F3=np.zeros((count, 3)), known_F=nothing, visible_F=unknown, near_F=nothing)
    times = recording.time_F[frames_F]
    smoothed = smooth(times, joined, value, noise, acceleration=_ACCELERATION)
    for _ in range(_ROUNDS):
        before, joined = joined, detected & _agrees(smoothed, value, noise)
        if not joined.any() or (joined == before).all():
            break
        smoothed = smooth(times, joined, value, noise, acceleration=_ACCELERATION)
    return _labelled(recording, frames_F, depth_FHW, smoothed)


def _own_shift(recording: Recording, frame: int, plan: PlanView) -> F64:
    """From where the vehicle believed to be to where it was: a detection is relative to the camera."""
    believed = geometry.matrix_from_quaternion(plan.world_from_cam_4)
    body_from_cam = geometry.rotation_y(-recording.mount.tilt_rad)
    lens = plan.start_pos_world_3 + believed @ body_from_cam.T @ np.array(recording.mount.position_m)
    return recording.pos_world_F3[frame] - lens


def _measured(seen_3: F64, lens_3: F64, world_from_cam_33: F64, depth_HW: NDArray[np.uint16]) -> tuple[F64, F64]:
    """A detection's position and covariance, its distance by depth where something stands about there."""
    pos_cam = world_from_cam_33.T @ (seen_3 - lens_3)
    along = float(np.linalg.norm(pos_cam))
    ray = pos_cam / along
    spread = _RANGE_SHARE * along
    if pos_cam[0] > 0.3:
        u, v = geometry.project(pos_cam, OURS)
        rows = slice(max(int(v) - _TRUNK_ROWS_PX, 0), max(int(v) + _TRUNK_ROWS_PX + 1, 0))
        columns = slice(max(int(u) - _TRUNK_PX, 0), max(int(u) + _TRUNK_PX + 1, 0))
        depth = depth_HW[rows, columns].astype(np.float64) / 1000
        depth = depth[(depth > 0) & (np.abs(depth - pos_cam[0]) < _MATCH_M)]
        if len(depth) >= _PIXELS:
            along = float(np.median(depth)) / ray[0] + _SURFACE_M
            spread = _RANGE_DEPTH_M
    direction = world_from_cam_33 @ ray
    line = np.outer(direction, direction)
    return lens_3 + along * direction, spread**2 * line + _LATERAL_M**2 * (np.eye(3) - line)


def _believed(recording: Recording, frames_F: NDArray[np.int64], value_F3: F64) -> NDArray[np.bool_]:
    """Which detections the onboard filter held at their image."""
    held = recording.flight.columns("target", ["stamp_ns", "pos_world", "confirmed", "since_seen_s"])
    if not len(held):
        return np.zeros(len(frames_F), dtype=bool)
    stamp = held["stamp_ns"]
    place = np.minimum(np.searchsorted(stamp, recording.stamp_F[frames_F]), len(stamp) - 1)
    sure = held["confirmed"].astype(bool)[place] & (held["since_seen_s"][place] <= _JUST_NOW_S)
    near = np.linalg.norm(held["pos_world"][place] - value_F3, axis=1) < _SEED_M
    return sure & near


def _agrees(smoothed: Smoothed, value_F3: F64, noise_F33: F64) -> NDArray[np.bool_]:
    off = value_F3 - smoothed.pos_T3
    spread = smoothed.covariance_T66[:, :3, :3] + noise_F33
    return np.einsum("fi,fi->f", off, np.linalg.solve(spread, off[..., None])[..., 0]) < _GATE


def _labelled(
    recording: Recording, frames_F: NDArray[np.int64], depth_FHW: NDArray[np.uint16], smoothed: Smoothed
) -> Track:
    pos, std = smoothed.pos_T3, smoothed.std_T
    off = pos - recording.pos_world_F3[frames_F]
    pos_cam = np.einsum("fji,fj->fi", recording.world_from_cam_F33[frames_F], off)
    ahead = pos_cam[:, 0] > 0.3
    u, v = geometry.project(np.where(ahead[:, None], pos_cam, [1.0, 0, 0]), OURS)
    inside_px = np.minimum(np.minimum(u, OURS.width - u), np.minimum(v, OURS.height - v))
    inside_px = np.where(ahead, inside_px, -np.inf)
    known, visible = std <= TRUSTED_M, np.zeros(len(frames_F))
    for f in np.flatnonzero(known & (inside_px > -_EDGE_PX)):
        nearer, there, farther = shares_around(depth_FHW[f], float(u[f]), float(v[f]), float(pos_cam[f, 0]), OURS)
        visible[f] = there / max(there + nearer, 1e-6)
        known[f] = inside_px[f] >= 0 and nearer + there > 0 and farther <= _CONTRADICTED
    return Track(
        pos_world_F3=pos, known_F=known, visible_F=np.where(known, visible, np.nan), near_F=std <= 2 * TRUSTED_M
    )
