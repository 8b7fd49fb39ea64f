"""Where each viewer's camera stands: it follows the vehicle, from wherever the viewer has turned it to.

A viewer's browser reports its camera late, and the first reports are of the camera it had before it was placed. So
the offset from the vehicle is kept here: the viewer's reports change it only once the placed camera has been seen in
one of them.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import viser

from goshawk_dashboards.state.views import Array, ControlView

CameraMode = Literal["Follow", "Chase", "Free"]

START_OFFSET_FLU_3 = np.array([-5.2, 2.0, 2.4])
"""Where a camera stands first, from the vehicle, along its heading: behind, a little left, above; metres."""
START_FOV_RAD = float(np.deg2rad(60.0))


class Viewpoint:
    """One viewer's offset from the vehicle, world axes, metres."""

    def __init__(self, offset_3: Array) -> None:
        self.offset_3 = offset_3
        self.settled = False
        """Whether the viewer has shown that the placed camera arrived."""

    def reported(self, offset_3: Array) -> None:
        """The viewer's own account of its camera."""
        if not np.isfinite(offset_3).all() or float(np.linalg.norm(offset_3)) < 0.05:
            return
        if self.settled:
            self.offset_3 = offset_3
        else:
            self.settled = float(np.linalg.norm(offset_3 - self.offset_3)) < 0.3

    def turn_behind(self, yaw: float) -> None:
        """Swings a little toward straight behind a vehicle that heads along ``yaw``."""
        have = float(np.arctan2(self.offset_3[1], self.offset_3[0]))
        left = (yaw + np.pi - have + np.pi) % (2.0 * np.pi) - np.pi
        self.offset_3 = turned(self.offset_3, 0.15 * left)


def place_first(server: viser.ViserServer) -> None:
    """The camera of a viewer that has not seen the vehicle yet."""
    server.initial_camera.fov = START_FOV_RAD


class ViewerCamera:
    """One viewer's camera."""

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._view: Viewpoint | None = None
        self._focus_3: Array | None = None

    def update(self, control: ControlView | None, mode: CameraMode) -> None:
        """Moves it along; Free leaves one that has been placed alone."""
        if control is None:
            return
        goal_3 = control.pos_world_3 + np.array([0.0, 0.0, 0.3])
        if self._focus_3 is None or float(np.linalg.norm(goal_3 - self._focus_3)) > 10.0:
            self._focus_3 = goal_3
        self._focus_3 = self._focus_3 + 0.35 * (goal_3 - self._focus_3)
        yaw = yaw_of(control.world_from_body_4)
        view = self._viewpoint(yaw)
        if mode == "Free" and view.settled:
            return
        if mode == "Chase":
            view.turn_behind(yaw)
        camera = self._client.camera
        wanted_3 = self._focus_3 + view.offset_3
        still = float(np.linalg.norm(camera.position - wanted_3)) < 0.005
        if still and float(np.linalg.norm(camera.look_at - self._focus_3)) < 0.005:
            return
        with self._client.atomic():
            camera.position = wanted_3
            camera.look_at = self._focus_3

    def _viewpoint(self, yaw: float) -> Viewpoint:
        if self._view is None:
            view = self._view = Viewpoint(turned(START_OFFSET_FLU_3, yaw))
            self._client.camera.on_update(lambda camera: view.reported(camera.position - camera.look_at))
        return self._view


def yaw_of(wxyz_4: Array) -> float:
    """Heading of a body's x axis, radians from east."""
    w, x, y, z = wxyz_4
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def turned(vector_3: Array, yaw: float) -> Array:
    """A vector turned about the world's z axis."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * vector_3[0] - s * vector_3[1], s * vector_3[0] + c * vector_3[1], vector_3[2]])
