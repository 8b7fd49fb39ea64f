"""The review: recorded flights in the live view's scene, on a timeline that each viewer has of their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass

import viser

from goshawk_dashboards.charts.beside import Beside
from goshawk_dashboards.gate import Addition, Gate, Role
from goshawk_dashboards.log import align, recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Replay
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.page.viewer import Guard, Viewer, Views
from goshawk_dashboards.review.altering import Replanner
from goshawk_dashboards.review.desk import PATH, Desk, Seat, Table
from goshawk_dashboards.review.dock import foot_html
from goshawk_dashboards.review.panels import ReviewPanels
from goshawk_dashboards.review.past import Past
from goshawk_dashboards.review.player import Player
from goshawk_dashboards.review.scene import ReviewOptions, ReviewScene
from goshawk_dashboards.scene.cameras import ViewerCamera, place_first
from goshawk_dashboards.scene.scene import prepare

RATE_HZ = 15.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """What is reviewed, with all that is worked out of it once."""

    flights: tuple[Flight, ...]
    """The one that is reviewed, and others beside it."""
    replay: Replay | None
    table: Table
    aligned: str

    @staticmethod
    def of(
        flights: Sequence[Flight], replay: Replay | None, replanner: Replanner | None, beside: Beside | None
    ) -> Recording:
        """Reads what is needed of the flights."""
        alignments = align.common(flights)
        again = tuple(flight.again() for flight in flights)
        table = Table(
            flights=again,
            replay=None if replay is None else replay.log.again(),
            marks=recorded.marks_of(flights[0]),
            stops_s=recorded.stops_s(flights[0]),
            alignments=alignments,
            replanner=replanner,
            beside=beside,
        )
        aligned = align.TAKE_OFF if align.TAKE_OFF in alignments else align.START
        return Recording(flights=tuple(flights), replay=replay, table=table, aligned=aligned)


class ReviewView:
    """What one viewer sees: playhead, panels, scene and camera of their own."""

    def __init__(self, viewer: Viewer, recording: Recording, wake: threading.Event) -> None:
        """``wake`` is set when the viewer has done something."""
        self.viewer = viewer
        self._recording = recording
        flight, table = recording.flights[0], recording.table
        by_s = table.alignments[recording.aligned]
        begin_s, end_s = table.axis_s(by_s)
        self.player = Player(end_s, wake, begin_s=begin_s)
        self.player.seek(recorded.begins_s(flight))
        self.seat = Seat(player=self.player, aligned=recording.aligned, by_s=by_s)
        self.scene = ReviewScene(viewer, recording.flights, recording.replay)
        self.panels = ReviewPanels(
            viewer,
            self.player,
            flight,
            marks=table.marks,
            stops_s=table.stops_s,
            has_replay=recording.replay is not None,
            has_others=len(recording.flights) > 1,
            beside="" if table.beside is None else table.beside.words,
        )
        self._past = Past(flight)
        self._camera = ViewerCamera(viewer) if isinstance(viewer, viser.ClientHandle) else None
        self.shown_s: float | None = None
        """The instant that was drawn last."""
        self._shown: tuple[float, bool, ReviewOptions] | None = None

    def show(self) -> None:
        """Draws the player's instant, if it is new or the viewer has done something."""
        again = self.player.moved.is_set()
        self.player.moved.clear()
        time_s, playing, options = self.player.time_s, self.player.playing, self.panels.options
        flight, replay = self._recording.flights[0], self._recording.replay
        if again or (time_s, playing, options) != self._shown:
            snap = recorded.snapshot_at(flight, time_s)
            altered = None if self.seat.altered is None else self.seat.altered.replay.plan_for(snap.plan)
            other = None if replay is None else replay.plan_for(snap.plan)
            replayed, is_altered = (other, False) if altered is None else (altered, True)
            self.scene.update(snap, replayed, options, self.seat.by_s, altered=is_altered)
            self.panels.update(snap, replayed, self._past.until(time_s), altered=is_altered)
            self._shown, self.shown_s = (time_s, playing, options), time_s
        if self._camera is not None:
            self._camera.update(flight.control_at(time_s), self.panels.camera_mode)


class ReviewDashboard:
    """Serves a review. What is drawn of the flights is read by one thread, its own once it has started."""

    def __init__(
        self,
        *,
        gate: Gate,
        flights: Sequence[Flight],
        replay: Replay | None = None,
        replanner: Replanner | None = None,
        beside: Beside | None = None,
    ) -> None:
        """The first flight is reviewed, the others lie over it. It closes the gate with itself.

        ``replanner`` plans again what a viewer alters. ``beside`` is another log of the first flight.
        """
        self._gate = gate
        self._recording = Recording.of(flights, replay, replanner, beside)
        desk = Desk(self._recording.table, self._seat_of, gate.folder)
        addition = Addition(foot=foot_html(), path=PATH, talk=desk.talk)
        self.server = open_server(gate, Role.OPERATOR, "Goshawk review", addition)
        prepare(self.server)
        place_first(self.server)
        self.beside = beside
        self._wake = threading.Event()
        self._guard = Guard()
        self._views = Views(self.server, lambda client: ReviewView(client, self._recording, self._wake))
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def _seat_of(self, client_id: int) -> Seat | None:
        for view in self.views:
            if isinstance(view.viewer, viser.ClientHandle) and view.viewer.client_id == client_id:
                return view.seat
        return None

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
                with self._guard.over(view):
                    view.player.advance(now_s - before_s)
                    view.show()
            before_s = now_s
