"""The live dashboard: a viser server that shows whatever snapshot it is handed, about 15 times a second."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

from goshawk_dashboards.cameras import Cameras
from goshawk_dashboards.commands import Watched
from goshawk_dashboards.panels import LivePanels
from goshawk_dashboards.scene import LiveScene
from goshawk_dashboards.serving import PortBusyError, close_server, open_server, url_of
from goshawk_dashboards.snapshot import Snapshot

__all__ = ["LiveDashboard", "PortBusyError"]

RATE_HZ = 15.0
TEXT_HZ = 5.0
PLOT_HZ = 4.0


class LiveDashboard:
    """Serves the live view of one vehicle or several: all in a table, one of them in full.

    Only one is in the 3-D view: each vehicle's world frame begins where its own odometry began, so that two of them
    drawn together would stand wrongly to each other.
    """

    def __init__(self, *, host: str, port: int, vehicles: Sequence[Watched]) -> None:
        """Raises PortBusyError if ``port`` cannot be bound, ValueError if there is no vehicle."""
        if not vehicles:
            raise ValueError("a dashboard needs a vehicle")
        self._vehicles = vehicles
        self._snaps: list[Snapshot] = []
        self.server = open_server(host, port, "Goshawk")
        self.scene = LiveScene(self.server)
        self.panels = LivePanels(self.server, vehicles, on_select=self._select, on_clear=self.scene.clear_trails)
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
        self.panels.commands.close()
        close_server(self.server)

    def _run(self) -> None:
        period_s = 1.0 / RATE_HZ
        due = time.monotonic()
        while not self._stop.is_set():
            self.panels.settle()
            self.tick(*self._newest())
            due = max(due + period_s, time.monotonic())
            self._stop.wait(due - time.monotonic())

    def _newest(self) -> list[Snapshot]:
        """One snapshot a vehicle; of those not shown in full only as often as the table is renewed."""
        whole = len(self._snaps) != len(self._vehicles) or time.monotonic() >= self._due["text"]
        self._snaps = [
            vehicle.latest() if whole or k == self.panels.shown else self._snaps[k]
            for k, vehicle in enumerate(self._vehicles)
        ]
        return self._snaps

    def _select(self) -> None:
        self.scene.forget()
        self._due["text"] = 0.0

    def tick(self, *snaps: Snapshot) -> None:
        """Shows one snapshot a vehicle; words and plots at their own slower rates."""
        snap = snaps[self.panels.shown]
        for group in self.panels.plots:
            group.sample(snap)
        self.scene.update(snap, self.panels.options)
        if self._is_due("text", snap.now_s, TEXT_HZ):
            self.panels.update(snaps)
        if self._is_due("plots", snap.now_s, PLOT_HZ):
            for group in self.panels.plots:
                group.draw()
        self._cameras.update(snap.control, self.panels.camera_mode)

    def _is_due(self, what: str, now_s: float, rate_hz: float) -> bool:
        if now_s < self._due[what]:
            return False
        self._due[what] = now_s + 1.0 / rate_hz
        return True
