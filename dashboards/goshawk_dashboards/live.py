"""The live dashboard: a viser server that shows whatever snapshot it is handed, about 15 times a second."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable

import numpy as np
import viser

from goshawk_dashboards import theme
from goshawk_dashboards.panels import LivePanels
from goshawk_dashboards.scene import LiveScene
from goshawk_dashboards.snapshot import Array, CommandView, Snapshot

RATE_HZ = 15.0
TEXT_HZ = 5.0
PLOT_HZ = 4.0
_START_OFFSET_FLU_3 = np.array([-5.2, 2.0, 2.4])
"""Where a viewer's camera stands first, from the vehicle, along its heading: behind, a little left, above; metres."""


class PortBusyError(OSError):
    """The dashboard's port is taken."""


class LiveDashboard:
    """Serves the live view. ``latest`` must be quick and safe from any thread; Start and Stop may block."""

    def __init__(
        self,
        *,
        host: str,
        port: int,
        latest: Callable[[], Snapshot],
        on_start: Callable[[str], CommandView],
        on_stop: Callable[[], CommandView],
    ) -> None:
        """Raises PortBusyError if ``port`` cannot be bound."""
        _check_free(host, port)
        self._latest = latest
        self.server = viser.ViserServer(host=host, port=port, label="Goshawk", verbose=False)
        self.server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, brand_color=theme.VEHICLE, control_width="large"
        )
        self.scene = LiveScene(self.server)
        self.panels = LivePanels(
            self.server, on_start=on_start, on_stop=on_stop, latest=latest, on_clear=self.scene.clear_trails
        )
        self.server.initial_camera.fov = float(np.deg2rad(60.0))
        self.server.on_client_connect(self._place_camera)
        self._focus_3: Array | None = None
        self._due = {"text": 0.0, "plots": 0.0}
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        """Where to point a browser on this machine."""
        host = self.server.get_host()
        return f"http://{'localhost' if host in ('0.0.0.0', '::') else host}:{self.server.get_port()}"

    def start(self) -> None:
        """Updates from a thread of its own until ``close``."""
        self._thread = threading.Thread(target=self._run, name="dashboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops updating and serving."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        self.server.stop()

    def _run(self) -> None:
        period_s = 1.0 / RATE_HZ
        due = time.monotonic()
        while not self._stop.is_set():
            self.tick(self._latest())
            due = max(due + period_s, time.monotonic())
            self._stop.wait(due - time.monotonic())

    def tick(self, snap: Snapshot) -> None:
        """Shows one snapshot; words and plots at their own slower rates."""
        self.panels.plots.sample(snap)
        self.scene.update(snap, self.panels.options)
        if self._is_due("text", snap.now_s, TEXT_HZ):
            self.panels.update(snap)
        if self._is_due("plots", snap.now_s, PLOT_HZ):
            self.panels.plots.draw()
        self._move_cameras(snap)

    def _is_due(self, what: str, now_s: float, rate_hz: float) -> bool:
        if now_s < self._due[what]:
            return False
        self._due[what] = now_s + 1.0 / rate_hz
        return True

    def _place_camera(self, client: viser.ClientHandle) -> None:
        control = self._latest().control
        focus_3 = np.array([0.0, 0.0, 1.0]) if control is None else control.pos_world_3
        yaw = 0.0 if control is None else _yaw(control.world_from_body_4)
        with client.atomic():
            client.camera.position = focus_3 + _turned(_START_OFFSET_FLU_3, yaw)
            client.camera.look_at = focus_3

    def _move_cameras(self, snap: Snapshot) -> None:
        """Keeps the vehicle in the middle, each viewer from where they look; Chase also stays behind it."""
        mode = self.panels.camera_mode
        if snap.control is None or mode == "Free":
            return
        goal_3 = snap.control.pos_world_3 + np.array([0.0, 0.0, 0.3])
        if self._focus_3 is None or float(np.linalg.norm(goal_3 - self._focus_3)) > 10.0:
            self._focus_3 = goal_3
        self._focus_3 = self._focus_3 + 0.35 * (goal_3 - self._focus_3)
        for client in self.server.get_clients().values():
            camera = client.camera
            offset_3 = camera.position - camera.look_at
            if mode == "Chase":
                offset_3 = _behind(snap, offset_3)
            if float(np.linalg.norm(camera.look_at - self._focus_3)) < 0.005 and mode == "Follow":
                continue
            with client.atomic():
                camera.position = self._focus_3 + offset_3
                camera.look_at = self._focus_3


def _behind(snap: Snapshot, offset_3: Array) -> Array:
    """The viewer's offset, turned a little toward straight behind the nose."""
    control = snap.control
    if control is None:
        return offset_3
    wanted = _yaw(control.world_from_body_4) + np.pi
    have = np.arctan2(offset_3[1], offset_3[0])
    return _turned(offset_3, 0.15 * ((wanted - have + np.pi) % (2.0 * np.pi) - np.pi))


def _yaw(wxyz_4: Array) -> float:
    w, x, y, z = wxyz_4
    return float(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))


def _turned(vector_3: Array, yaw: float) -> Array:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([c * vector_3[0] - s * vector_3[1], s * vector_3[0] + c * vector_3[1], vector_3[2]])


def _check_free(host: str, port: int) -> None:
    """viser would quietly take the next port; an operator must get the address they asked for, or be told."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise PortBusyError(f"cannot serve the dashboard on {host}:{port}: {error.strerror}") from error
