"""What fails for one browser, or for one vehicle, is left out for it alone: everybody else's page goes on."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
import recordings as rec
from goshawk_dashboards.gate import Access, Gate, Role
from goshawk_dashboards.gate.client import CAMERA, open_page
from goshawk_dashboards.live.dashboard import LiveDashboard, LiveView
from goshawk_dashboards.live.feed import Watched
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.review.dashboard import ReviewDashboard
from goshawk_dashboards.review.player import Player
from goshawk_dashboards.state.snapshot import Snapshot
from websockets.sync.connection import Connection

Make = Callable[..., Snapshot]
WAIT_S = 20.0


def gate() -> Gate:
    """On a free port."""
    return Gate(host="127.0.0.1", port=0, access=Access())


def watched(name: str, latest: Callable[[], Snapshot]) -> Watched:
    """A vehicle that takes no command."""

    def no_start(_profile: str) -> Any:
        raise AssertionError

    return Watched(name=name, latest=latest, on_start=no_start, on_stop=lambda: None, on_cancel=lambda: None)


@pytest.fixture
def live(snap: Make) -> Iterator[LiveDashboard]:
    """Of one vehicle; its own thread is not running."""
    dashboard = LiveDashboard(gate=gate(), vehicles=[watched("goshawk", snap)])
    yield dashboard
    dashboard.close()


def until(live: LiveDashboard, done: Callable[[], bool]) -> None:
    """Ticks until it is done."""
    until_s = time.monotonic() + WAIT_S
    while not done():
        assert time.monotonic() < until_s
        live.tick(time.monotonic())
        time.sleep(0.01)


def say(page: Connection, **camera: Any) -> None:
    """Tells where a browser's camera is."""
    page.send(msgspec.msgpack.encode(CAMERA | camera))


def drawn(monkeypatch: pytest.MonkeyPatch) -> list[LiveView]:
    """Whose picture was drawn to its end."""
    found, draw = list[LiveView](), LiveView.draw

    def watch(view: LiveView, *, words: bool, slow: bool) -> None:
        draw(view, words=words, slow=slow)
        found.append(view)

    monkeypatch.setattr(LiveView, "draw", watch)
    return found


def test_a_window_without_height_is_drawn_for_like_any_other(
    live: LiveDashboard, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = drawn(monkeypatch)
    with open_page(live.observer_url) as page:
        say(page, image_height=0)
        until(live, lambda: len(live.views) == 1)
        found.clear()
        live.tick(time.monotonic() + 10.0)
        assert found == list(live.views)


@pytest.mark.filterwarnings("ignore:.viser. .* does not match annotation")
def test_a_camera_that_is_nowhere_stops_nobody_elses_picture_and_is_logged_once(
    live: LiveDashboard, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    # An operator's messages pass the gate unread.
    with open_page(live.url) as bad, open_page(live.observer_url) as good:
        say(bad)
        say(good)
        until(live, lambda: len(live.views) == 2)
        (client,) = live.servers[Role.OPERATOR].get_clients().values()
        say(bad, position=(1.0, 2.0))
        until(live, lambda: len(client.camera.position) == 2)
        found = drawn(monkeypatch)
        for k in range(5):
            live.tick(time.monotonic() + 10.0 + k)
        _, observer = live.views
        assert found == [observer] * 5
    assert [record.name for record in caplog.records if record.exc_info] == ["goshawk_dashboards.page.viewer"]


def test_a_vehicle_that_cannot_be_read_stops_no_other(snap: Make) -> None:
    broken = threading.Event()

    def latest() -> Snapshot:
        if broken.is_set():
            raise ValueError("nonsense")
        return snap()

    dashboard = LiveDashboard(gate=gate(), vehicles=[watched("alpha", latest), watched("bravo", snap)])
    try:
        broken.set()
        before = dashboard.feeds[1].snap
        dashboard.tick(1.0)
        assert dashboard.feeds[1].snap is not before
    finally:
        dashboard.close()


def test_a_view_that_fails_does_not_stop_the_review_of_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight.open(rec.write_flight(tmp_path / "flight.mcap", 1.5))
    dashboard = ReviewDashboard(gate=gate(), flights=[flight])
    shown = threading.Semaphore(0)

    def fails() -> None:
        raise ValueError("nonsense")

    class View:
        """One viewer's."""

        def __init__(self, show: Callable[[], object]) -> None:
            self.player, self.show = Player(1.0), show

    views = [View(fails), View(shown.release)]
    monkeypatch.setattr(dashboard, "_views", SimpleNamespace(settle=lambda: views))
    dashboard.start()
    try:
        for _ in range(3):
            assert shown.acquire(timeout=WAIT_S)
    finally:
        dashboard.close()
