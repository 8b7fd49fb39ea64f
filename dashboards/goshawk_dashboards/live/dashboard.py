"""The live dashboard: a viser server that shows whatever snapshots it is handed, about 15 times a second.

What is shown is each viewer's own choice; what is shown of one vehicle is worked out once for all who look at it.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence

import viser

from goshawk_dashboards.gate import Addition, Gate, PortBusyError, Role
from goshawk_dashboards.live.feed import Feed, Watched
from goshawk_dashboards.live.overlay import foot_html
from goshawk_dashboards.live.panels import LivePanels
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.page.viewer import Guard, Viewer, Views
from goshawk_dashboards.scene.cameras import ViewerCamera, place_first
from goshawk_dashboards.scene.scene import LiveScene, prepare

__all__ = ["LiveDashboard", "LiveView", "PortBusyError"]

RATE_HZ = 15.0
TEXT_HZ = 5.0
SLOW_HZ = 2.0


class LiveView:
    """What one viewer sees: panels, scene and camera of their own.

    Only one vehicle is in the 3-D view: each vehicle's world frame begins where its own odometry began, so that two of
    them drawn together would stand wrongly to each other.
    """

    def __init__(self, viewer: Viewer, feeds: Sequence[Feed], *, commands: bool = True) -> None:
        """``commands``: with the buttons and keys that command."""
        self.viewer = viewer
        self._feeds = feeds
        self.scene = LiveScene(viewer)
        self.panels = LivePanels(
            viewer,
            feeds,
            commands=commands,
            on_select=self._select,
            on_clear=self.scene.clear_trails,
            on_armed=self._words_now,
            narrow=self._narrow,
        )
        self._camera = ViewerCamera(viewer) if isinstance(viewer, viser.ClientHandle) else None
        self._late = True

    def _narrow(self) -> bool:
        """Whether the browser's window may be a phone's, upright: panels are folded away there."""
        viewer = self.viewer
        if not isinstance(viewer, viser.ClientHandle) or viewer.camera.image_height == 0:
            return False
        return viewer.camera.aspect < 1.0

    def _select(self) -> None:
        self.scene.forget()
        self._words_now()

    def _words_now(self) -> None:
        self._late = True

    def draw(self, *, words: bool, slow: bool) -> None:
        """Shows what the feeds hold; ``words`` and ``slow`` are due at their own slower rates."""
        self.panels.settle()
        snap = self._feeds[self.panels.shown].snap
        self.scene.update(snap, self.panels.options)
        slow, words, self._late = slow or self._late, words or self._late, False
        if words:
            self.panels.update()
        if slow:
            self.panels.update_slow()
        if self._camera is not None:
            self._camera.update(snap.control, self.panels.camera_mode)


class LiveDashboard:
    """Serves the live view of one vehicle or several: all in a table, one of them in full.

    Operators and observers have a viser server each. The observers' knows no command, so nothing that a browser of
    theirs sends can be one.
    """

    def __init__(self, *, gate: Gate, vehicles: Sequence[Watched]) -> None:
        """For whoever comes through ``gate``, which it closes with itself. Raises ValueError if there is no vehicle."""
        if not vehicles:
            raise ValueError("a dashboard needs a vehicle")
        self.feeds = [Feed(vehicle) for vehicle in vehicles]
        self._gate = gate
        over = Addition(foot=foot_html())
        self.servers = {
            Role.OPERATOR: open_server(gate, Role.OPERATOR, "Goshawk", over),
            Role.OBSERVER: open_server(gate, Role.OBSERVER, "Goshawk, observing", over),
        }
        self._views = [self._views_of(role) for role in self.servers]
        self._guard = Guard()
        self._due = {"text": 0.0, "slow": 0.0}
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None

    def _views_of(self, role: Role) -> Views[LiveView]:
        server, commands = self.servers[role], role is Role.OPERATOR
        prepare(server)
        place_first(server)
        return Views(server, lambda client: LiveView(client, self.feeds, commands=commands))

    @property
    def views(self) -> tuple[LiveView, ...]:
        """One for each browser that is connected, operators' first, then the oldest first."""
        return tuple(view for views in self._views for view in views.all)

    @property
    def url(self) -> str:
        """The link that opens it in a browser on this machine, to command."""
        return self._gate.link(Role.OPERATOR)

    @property
    def observer_url(self) -> str:
        """The link that opens it to see and no more."""
        return self._gate.link(Role.OBSERVER)

    def start(self) -> None:
        """Updates from a thread of its own until ``close``."""
        self._thread = threading.Thread(target=self._run, name="dashboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stops updating and serving."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=5.0)
        for server in self.servers.values():
            close_server(server)
        self._gate.close()

    def _run(self) -> None:
        period_s = 1.0 / RATE_HZ
        due = time.monotonic()
        while not self._stop.is_set():
            self.tick(time.monotonic())
            due = max(due + period_s, time.monotonic())
            self._stop.wait(due - time.monotonic())

    def tick(self, now_s: float) -> None:
        """Takes what is new of the vehicles and shows it to everyone."""
        views = [view for views in self._views for view in views.settle()]
        words, slow = self._is_due("text", now_s, TEXT_HZ), self._is_due("slow", now_s, SLOW_HZ)
        shown = {view.panels.shown for view in views}
        for k, feed in enumerate(self.feeds):
            with self._guard.over(feed):
                # Those that nobody shows in full only as often as the table is renewed.
                if words or k in shown:
                    feed.take(feed.vehicle.latest())
                if words:
                    feed.judge()
        for view in views:
            with self._guard.over(view):
                view.draw(words=words, slow=slow)

    def _is_due(self, what: str, now_s: float, rate_hz: float) -> bool:
        if now_s < self._due[what]:
            return False
        self._due[what] = now_s + 1.0 / rate_hz
        return True
