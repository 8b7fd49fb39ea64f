"""The review: a recorded flight, or two, on a timeline, in the live view's scene."""

from __future__ import annotations

import threading
import time

from goshawk_dashboards import recorded
from goshawk_dashboards.cameras import Cameras
from goshawk_dashboards.flight import Flight
from goshawk_dashboards.player import Player
from goshawk_dashboards.recorded import Replay
from goshawk_dashboards.review_panels import ReviewPanels
from goshawk_dashboards.review_plots import plots_of
from goshawk_dashboards.review_scene import ReviewOptions, ReviewScene
from goshawk_dashboards.serving import close_server, open_server, url_of

RATE_HZ = 15.0


class ReviewDashboard:
    """Serves a review. Everything of the flights is read by one thread, its own once it has started."""

    def __init__(
        self, *, host: str, port: int, flight: Flight, replay: Replay | None = None, second: Flight | None = None
    ) -> None:
        """``second`` is laid over the first such that both take off at once. Raises PortBusyError."""
        self._flight, self._replay = flight, replay
        by_s = 0.0 if second is None else recorded.takeoff_s(flight) - recorded.takeoff_s(second)
        ends_s = flight.duration_s if second is None else max(flight.duration_s, second.duration_s + by_s)
        self.player = Player(ends_s)
        self.player.seek(recorded.begins_s(flight))
        plots = plots_of(flight, replay, second, by_s)
        marks, stops_s = recorded.marks_of(flight), recorded.stops_s(flight)
        self.server = open_server(host, port, "Goshawk review")
        self.scene = ReviewScene(self.server, flight, replay, second, by_s)
        self.panels = ReviewPanels(
            self.server,
            self.player,
            flight,
            marks=marks,
            stops_s=stops_s,
            plots=plots,
            has_replay=replay is not None,
            has_second=second is not None,
        )
        self._cameras = Cameras(self.server)
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.shown_s: float | None = None
        """The instant that was drawn last."""
        self._shown: tuple[float, bool, ReviewOptions] | None = None

    @property
    def url(self) -> str:
        """Where to point a browser on this machine."""
        return url_of(self.server)

    def start(self) -> None:
        """Plays from a thread of its own until ``close``."""
        self._thread = threading.Thread(target=self._run, name="review", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops playing and serving."""
        self._stop.set()
        self.player.moved.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        close_server(self.server)

    def _run(self) -> None:
        before_s = time.monotonic()
        while not self._stop.is_set():
            # Whatever the viewer does wakes it at once; else the next picture is due.
            moved = self.player.moved.wait(1.0 / RATE_HZ)
            self.player.moved.clear()
            now_s = time.monotonic()
            self.player.advance(now_s - before_s)
            before_s = now_s
            self.show(again=moved)

    def show(self, *, again: bool = False) -> None:
        """Draws the player's instant; ``again``: also if it is the one that is drawn already."""
        time_s, playing, options = self.player.time_s, self.player.playing, self.panels.options
        if again or (time_s, playing, options) != self._shown:
            snap = recorded.snapshot_at(self._flight, time_s)
            replayed = None if self._replay is None else self._replay.plan_for(snap.plan)
            self.scene.update(snap, replayed, options)
            self.panels.update(snap, replayed)
            self._shown, self.shown_s = (time_s, playing, options), time_s
        self._cameras.update(self._flight.control_at(time_s), self.panels.camera_mode)
