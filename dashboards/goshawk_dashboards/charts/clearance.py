"""How near obstacles were, by what the camera's depth showed.

Depth points of the last seconds are gathered in the world frame, so that a tree seen ahead counts when it is passed
at the side. The chased target is left out, and so is the ground. Shape suffixes: P points, M instants.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_dashboards.exports import frames
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.progress import Progress, unheard
from goshawk_dashboards.state.views import Array

RATE_HZ = 10.0
REMEMBERED_S = 3.0
FARTHEST_M = 4.0
"""Depth noise grows with the distance squared: what was only ever seen from farther away does not count."""
CELL_M = 0.15
LEAST_POINTS = 3
"""A cell with fewer is noise."""
TARGET_RADIUS_M = 0.8
GROUND_M = 0.3
"""Nothing lower than this above where it took off counts: the ground, and what a flight at height does not meet."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Clearance:
    """The distance from the vehicle's middle to the nearest surface, m; NaN where depth showed none."""

    times_s_M: Array
    nearest_m_M: Array

    @property
    def least_m(self) -> float | None:
        """The least of the flight; None where depth never showed anything."""
        shown = self.nearest_m_M[np.isfinite(self.nearest_m_M)]
        return float(shown.min()) if len(shown) else None

    def within(self, use_M: NDArray[np.bool_]) -> Clearance:
        """Of some of its instants."""
        return Clearance(times_s_M=self.times_s_M[use_M], nearest_m_M=self.nearest_m_M[use_M])


def seen_clearance(flight: Flight, progress: Progress = unheard) -> Clearance | None:
    """None if the log has no depth, or the vehicle file does not say where the camera is."""
    mount = frames.camera_mount(flight.header)
    control = flight.columns("control", ["pos_world", "world_from_body"])
    flown = np.flatnonzero(np.linalg.norm(control["world_from_body"], axis=1) > 0.5)
    if mount is None or flight.count("rgbd") == 0 or len(flown) == 0:
        return None
    floor_m = float(control["pos_world"][flown[0], 2]) + GROUND_M
    flown_s = control.times_s[flown]
    # Where nothing was flown there is no instant: a record may come a day late.
    ticks = np.unique(((flown_s - flown_s[0]) * RATE_HZ).astype(np.int64))
    times_s_M = np.unique(np.append(flown_s[0] + ticks / RATE_HZ, flown_s[-1]))
    clouds: list[tuple[float, NDArray[np.float32]]] = []
    newest: int | None = None
    nearest_m_M = np.full(len(times_s_M), np.nan)
    for m, time_s in enumerate(times_s_M):
        progress("clearance by depth", m + 1, len(times_s_M))
        pos_3 = control["pos_world"][_newest(flown, flown_s, float(time_s))]
        # Each picture once, from where it was taken: a camera that has stopped shows nothing new.
        picture = flight.index_at("rgbd", float(time_s))
        if picture is not None and picture != newest:
            newest, taken_s = picture, flight.time_s("rgbd", picture)
            index = _newest(flown, flown_s, taken_s)
            pose = (control["pos_world"][index], control["world_from_body"][index])
            cloud = _cloud(flight, taken_s, *pose, mount, floor_m)
            if cloud is not None:
                clouds.append((taken_s, cloud))
        clouds = [(t, c) for t, c in clouds if t >= time_s - REMEMBERED_S]
        if clouds and pos_3[2] > floor_m:
            points_P3 = np.concatenate([c for _, c in clouds])
            if len(points_P3):
                nearest_m_M[m] = np.sqrt(((points_P3 - pos_3.astype(np.float32)) ** 2).sum(axis=1).min())
    return Clearance(times_s_M=times_s_M, nearest_m_M=nearest_m_M)


def _newest(flown: NDArray[np.intp], flown_s: Array, time_s: float) -> int:
    """The controller's step at a time; before the first, that."""
    return int(flown[max(int(np.searchsorted(flown_s, time_s, side="right")) - 1, 0)])


def _cloud(
    flight: Flight, time_s: float, pos_3: Array, q_4: Array, mount: frames.Mount, floor_m: float
) -> NDArray[np.float32] | None:
    """One frame's surfaces in the world, a point a cell; None if there is no frame with depth."""
    frame = flight.frame_at(time_s)
    points = None if frame is None else frame.points_cam_P3(FARTHEST_M)
    if points is None:
        return None
    body_P3 = points[0] @ frames.matrix(mount.body_from_camera_4).T + mount.pos_body_3
    world_P3 = body_P3 @ frames.matrix(q_4).T + pos_3
    world_P3 = world_P3[world_P3[:, 2] > floor_m]
    target = flight.target_at(time_s)
    if target is not None:
        world_P3 = world_P3[np.linalg.norm(world_P3[:, :2] - target.pos_world_3[:2], axis=1) > TARGET_RADIUS_M]
    # A cell's three indices as one number: 20 bits each is 150 km.
    cell_P3 = np.floor(world_P3 / CELL_M).astype(np.int64) & 0xFFFFF
    key_P = (cell_P3[:, 0] << 40) | (cell_P3[:, 1] << 20) | cell_P3[:, 2]
    _, first, counts = np.unique(key_P, return_index=True, return_counts=True)
    return world_P3[first[counts >= LEAST_POINTS]].astype(np.float32)
