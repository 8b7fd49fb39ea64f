"""The review: a recorded flight, or two, in the live view's scene, on a timeline that each viewer has of their own."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

import viser

from goshawk_dashboards.gate import Gate, Role
from goshawk_dashboards.log import recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Mark, Replay
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.page.viewer import Viewer, Views
from goshawk_dashboards.review.panels import ReviewPanels
from goshawk_dashboards.review.player import Player
from goshawk_dashboards.review.plots import Plot, plots_of
from goshawk_dashboards.review.scene import ReviewOptions, ReviewScene
from goshawk_dashboards.scene.cameras import ViewerCamera, place_first
from goshawk_dashboards.scene.scene import prepare
from goshawk_dashboards.state.views import Array

RATE_HZ = 15.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What is reviewed, with all that is worked out of it once."""

    flight: Flight
    replay: Replay | None
    second: Flight | None
    by_s: float
    """How much the second flight is delayed, so that both take off at once."""
    duration_s: float
    plots: tuple[Plot, ...]
    marks: tuple[Mark, ...]
    stops_s: Array

    @staticmethod
    def of(flight: Flight, replay: Replay | None, second: Flight | None) -> Recording:
        """Reads what is needed of the flights."""
        by_s = 0.0 if second is None else recorded.takeoff_s(flight) - recorded.takeoff_s(second)
        return Recording(
            flight=flight,
            replay=replay,
            second=second,
            by_s=by_s,
            duration_s=flight.duration_s if second is None else max(flight.duration_s, second.duration_s + by_s),
            plots=plots_of(flight, replay, second, by_s),
            marks=recorded.marks_of(flight),
            stops_s=recorded.stops_s(flight),
        )


class ReviewView:
    """What one viewer sees: playhead, panels, scene and camera of their own."""

    def __init__(self, viewer: Viewer, recording: Recording, wake: threading.Event) -> None:
        """``wake`` is set when the viewer has done something."""
        self.viewer = viewer
        self._recording = recording
        flight = recording.flight
        self.player = Player(recording.duration_s, wake)
        self.player.seek(recorded.begins_s(flight))
        self.scene = ReviewScene(viewer, flight, recording.replay, recording.second, recording.by_s)
        self.panels = ReviewPanels(
            viewer,
            self.player,
            flight,
            marks=recording.marks,
            stops_s=recording.stops_s,
            plots=recording.plots,
            has_replay=recording.replay is not None,
            has_second=recording.second is not None,
        )
        self._camera = ViewerCamera(viewer) if isinstance(viewer, viser.ClientHandle) else None
        self.shown_s: float | None = None
        """The instant that was drawn last."""
        self._shown: tuple[float, bool, ReviewOptions] | None = None

    def show(self) -> None:
        """Draws the player's instant, if it is new or the viewer has done something."""
        again = self.player.moved.is_set()
        self.player.moved.clear()
        time_s, playing, options = self.player.time_s, self.player.playing, self.panels.options
        flight, replay = self._recording.flight, self._recording.replay
        if again or (time_s, playing, options) != self._shown:
            snap = recorded.snapshot_at(flight, time_s)
            replayed = None if replay is None else replay.plan_for(snap.plan)
            self.scene.update(snap, replayed, options)
            self.panels.update(snap, replayed)
            self._shown, self.shown_s = (time_s, playing, options), time_s
        if self._camera is not None:
            self._camera.update(flight.control_at(time_s), self.panels.camera_mode)


class ReviewDashboard:
    """Serves a review. Everything of the flights is read by one thread, its own once it has started."""

    def __init__(
        self, *, gate: Gate, flight: Flight, replay: Replay | None = None, second: Flight | None = None
    ) -> None:
        """``second`` is laid over the first such that both take off at once. It closes the gate with itself."""
        self._gate = gate
        self._recording = Recording.of(flight, replay, second)
        self.server = open_server(gate, Role.OPERATOR, "Goshawk review")
        prepare(self.server)
        place_first(self.server)
        self._wake = threading.Event()
        self._views = Views(self.server, lambda client: ReviewView(client, self._recording, self._wake))
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def views(self) -> tuple[ReviewView, ...]:
        """One for each browser that is connected, the oldest first."""
        return self._views.all

    @property
    def url(self) -> str:
        """The link that opens it in a browser on this machine."""
        return self._gate.link(Role.OPERATOR)

    def start(self) -> None:
        """Plays from a thread of its own until ``close``."""
        self._thread = threading.Thread(target=self._run, name="review", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops playing and serving."""
        self._stop.set()
        self._wake.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        close_server(self.server)
        self._gate.close()

    def _run(self) -> None:
        before_s = time.monotonic()
        while not self._stop.is_set():
            # Whatever a viewer does wakes it at once; else the next picture is due.
            self._wake.wait(1.0 / RATE_HZ)
            self._wake.clear()
            views = self._views.settle()
            now_s = time.monotonic()
            for view in views:
                view.player.advance(now_s - before_s)
                view.show()
            before_s = now_s
