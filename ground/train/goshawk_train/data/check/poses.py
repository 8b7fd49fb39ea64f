"""Labels that cannot be: poses in trunks or under ground, targets out of view or hidden though marked visible."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data.check.findings import Finding, numbers
from goshawk_train.data.layout import Labels, View
from goshawk_train.data.raymap import RayMap
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

_NORM_TOLERANCE = 1e-3
_GROUND_DIFFERENCE_M = 0.3
_MARGIN_PX = 4.0
_SEEN = 0.8
"""A target labelled so visible must be seen in the depth image where it is said to be."""
_UNSEEN = 0.05
_JUDGED_M = 10.0
_TARGET_DEPTH_M = 0.7
_HALF_WIDTH_M, _HALF_HEIGHT_M = 0.15, 0.45
_PIXELS_NEEDED = 6
_CONTRADICTED = 0.8
_BLANK_WITHIN_M, _BLANK_SHARE = 6.0, 0.2


def target_in_camera(labels: Labels) -> F64:
    """The targets in camera frames, [F, 3]; meaningless where there is none."""
    return np.einsum("fji,fj->fi", labels.world_from_cam_F33, labels.target_world_F3 - labels.pos_world_F3)


def check_poses(scene: str, labels: Labels, raymap: RayMap) -> list[Finding]:
    """Attitudes, places and heights of a scene's frames."""
    norm = np.linalg.norm(labels.quaternion_F4, axis=1)
    ground = raymap.ground.at(labels.pos_world_F3)
    under = labels.pos_world_F3[:, 2] < ground
    outside = ~raymap.covers(labels.pos_world_F3)
    differs = np.abs(ground - labels.ground_F) > _GROUND_DIFFERENCE_M
    axes = "write poses and environment.ply in the same axes and metres, z up"
    rules = [
        (
            "quaternion",
            np.abs(norm - 1) > _NORM_TOLERANCE,
            f"the quaternion's length is not 1 (up to {norm[np.abs(norm - 1).argmax()]:.3f})",
            "write unit quaternions qw, qx, qy, qz of world from camera",
        ),
        ("pose-in-obstacle", raymap.inside(labels.pos_world_F3) & ~under, "the camera is inside an obstacle", axes),
        ("pose-under-ground", under & ~outside, "the camera is under the ground", axes),
        ("pose-outside-map", outside, "the camera is outside of the map's box", axes),
        (
            "ground-differs",
            differs & ~outside,
            f"ground_z and ground.npy differ by up to {np.abs(ground - labels.ground_F).max():.1f} m",
            "ground.npy must be heights [y, x] from ground_min_xy on",
        ),
        (
            "visible-range",
            (labels.visible_F < 0) | (labels.visible_F > 1),
            "visible is not within 0 to 1",
            "write the share of the target that is seen",
        ),
    ]
    return [
        Finding(severity="error", kind=kind, where=scene, frames=numbers(mask), what=what, advice=advice)
        for kind, mask, what, advice in rules
        if mask.any()
    ]


def check_blank(scene: str, blank_F: NDArray[np.bool_], labels: Labels, raymap: RayMap, view: View) -> list[Finding]:
    """Frames without depth although the map has something within the camera's reach."""
    rays = geometry.pixel_rays(view).reshape(-1, 3)[:: view.width // 2 + 1]
    wrong = np.zeros(len(labels), dtype=bool)
    for f in np.flatnonzero(blank_F):
        ray = rays @ labels.world_from_cam_F33[f].T
        reach = raymap.depth(np.broadcast_to(labels.pos_world_F3[f], ray.shape), ray)
        wrong[f] = (reach < _BLANK_WITHIN_M).mean() > _BLANK_SHARE
    what = f"there is no depth at all, but the map has things within {_BLANK_WITHIN_M:.0f} m"
    finding = Finding(
        severity="error",
        kind="depth-blank",
        where=scene,
        frames=numbers(wrong),
        what=what,
        advice="write the measured depth, millimetres, 0 only where there is none",
    )
    return [finding] if wrong.any() else []


def check_targets(
    scene: str, labels: Labels, depth_FHW: NDArray[np.uint16], raymap: RayMap, view: View
) -> list[Finding]:
    """The labelled targets against the depth image where they should be.

    Only for a scene that agrees with its map: otherwise the poses are to blame, not the labels.
    """
    pos_cam = target_in_camera(labels)
    ahead = pos_cam[:, 0] > 0.2
    u, v = geometry.project(np.where(ahead[:, None], pos_cam, [1.0, 0, 0]), view)
    inside = (u > -_MARGIN_PX) & (u < view.width + _MARGIN_PX) & (v > -_MARGIN_PX) & (v < view.height + _MARGIN_PX)
    in_view = ahead & inside
    marked = labels.has_target_F & (labels.visible_F >= 0.5)
    judged = labels.has_target_F & in_view & (pos_cam[:, 0] < _JUDGED_M)
    ray = (labels.target_world_F3 - labels.pos_world_F3) / np.where(ahead, pos_cam[:, 0], 1.0)[:, None]
    # A trunk right before the target has nearly its depth: only the map tells them apart.
    free = raymap.depth(labels.pos_world_F3, ray) > pos_cam[:, 0] + _TARGET_DEPTH_M
    hidden, absent, open_ = (np.zeros(len(labels), dtype=bool) for _ in range(3))
    for f in np.flatnonzero(judged):
        nearer, there, farther = shares_around(depth_FHW[f], u[f], v[f], pos_cam[f, 0], view)
        hidden[f] = labels.visible_F[f] >= _SEEN and nearer > _CONTRADICTED
        absent[f] = labels.visible_F[f] >= _SEEN and farther > _CONTRADICTED
        open_[f] = labels.visible_F[f] <= _UNSEEN and there > _CONTRADICTED and free[f]
    mark = "correct `visible`, or the target's position"
    rules = [
        ("target-out-of-view", marked & ~in_view, "the target is marked visible but out of view", mark),
        ("target-occluded", hidden, "the target is marked visible but something stands before it", mark),
        ("target-absent", absent, "the target is marked visible but depth shows nothing there", mark),
        ("target-unmarked", open_, "the target is marked hidden but depth shows it", mark),
    ]
    return [
        Finding(severity="error", kind=kind, where=scene, frames=numbers(mask), what=what, advice=advice)
        for kind, mask, what, advice in rules
        if mask.any()
    ]


def shares_around(
    depth_HW: NDArray[np.uint16], u: float, v: float, x_m: float, view: View
) -> tuple[float, float, float]:
    """Shares of the measurements at a body's trunk that are nearer than it, at it, and farther; all 0 of too few."""
    half_u, half_v = (max(half * view.focal_px / x_m, 1.0) for half in (_HALF_WIDTH_M, _HALF_HEIGHT_M))
    rows = slice(int(max(v - half_v, 0)), int(max(v + half_v + 1, 0)))
    columns = slice(int(max(u - half_u, 0)), int(max(u + half_u + 1, 0)))
    depth = depth_HW[rows, columns].astype(np.float64) / 1000
    depth = depth[depth > 0]
    if len(depth) < _PIXELS_NEEDED:
        return 0.0, 0.0, 0.0
    near, far = (depth < x_m - _TARGET_DEPTH_M).mean(), (depth > x_m + _TARGET_DEPTH_M).mean()
    return float(near), float(1 - near - far), float(far)
