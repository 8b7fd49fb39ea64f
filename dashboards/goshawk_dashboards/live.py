"""The live dashboard: a viser server that shows whatever snapshot it is handed, about 15 times a second."""

from __future__ import annotations

import contextlib
import io
import socket
import threading
import time
from collections.abc import Callable

import viser

from goshawk_dashboards import theme
from goshawk_dashboards.cameras import Cameras
from goshawk_dashboards.panels import LivePanels
from goshawk_dashboards.scene import LiveScene
from goshawk_dashboards.snapshot import CommandView, Snapshot

RATE_HZ = 15.0
TEXT_HZ = 5.0
PLOT_HZ = 4.0


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
        with contextlib.redirect_stdout(io.StringIO()):  # its banner; the address is the caller's to print
            self.server = viser.ViserServer(host=host, port=port, label="Goshawk", verbose=False)
        self.server.gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, brand_color=theme.VEHICLE, control_width="large"
        )
        self.scene = LiveScene(self.server)
        self.panels = LivePanels(
            self.server, on_start=on_start, on_stop=on_stop, latest=latest, on_clear=self.scene.clear_trails
        )
        self._cameras = Cameras(self.server)
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
        with contextlib.redirect_stdout(io.StringIO()):
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
        self._cameras.update(snap.control, self.panels.camera_mode)

    def _is_due(self, what: str, now_s: float, rate_hz: float) -> bool:
        if now_s < self._due[what]:
            return False
        self._due[what] = now_s + 1.0 / rate_hz
        return True


def _check_free(host: str, port: int) -> None:
    """viser would quietly take the next port; an operator must get the address they asked for, or be told."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise PortBusyError(f"cannot serve the dashboard on {host}:{port}: {error.strerror}") from error
