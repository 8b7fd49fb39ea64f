"""The live dashboard: a viser server that shows whatever snapshot it is handed, about 15 times a second."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from goshawk_dashboards.cameras import Cameras
from goshawk_dashboards.panels import LivePanels
from goshawk_dashboards.scene import LiveScene
from goshawk_dashboards.serving import PortBusyError, close_server, open_server, url_of
from goshawk_dashboards.snapshot import CommandView, Snapshot

__all__ = ["LiveDashboard", "PortBusyError"]

RATE_HZ = 15.0
TEXT_HZ = 5.0
PLOT_HZ = 4.0


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
        self._latest = latest
        self.server = open_server(host, port, "Goshawk")
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
        return url_of(self.server)

    def start(self) -> None:
        """Updates from a thread of its own until ``close``."""
        self._thread = threading.Thread(target=self._run, name="dashboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops updating and serving."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        close_server(self.server)

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
