"""The demo waits for somebody to look, and not for ever."""

from __future__ import annotations

import threading
import webbrowser

import pytest
from goshawk_dashboards.gate import Access, Gate
from goshawk_dashboards.live.dashboard import LiveDashboard
from goshawk_dashboards.live.feed import Watched
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.demo.browser import await_browser
from rich.console import Console


def latest() -> Snapshot:
    """Of a vehicle that nobody has heard."""
    return Snapshot(now_s=0.0, vehicle="goshawk", endpoint="tcp/127.0.0.1:1", linked=False, alive=False)


def refuse(*_: object) -> None:
    """Answers nothing."""


def test_nobody_who_looks_is_waited_for_a_while_and_a_browser_opens_on_a_desktop_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    vehicle = Watched(name="goshawk", latest=latest, on_start=lambda _: None, on_stop=refuse, on_cancel=refuse)  # type: ignore[arg-type, return-value]
    dashboard = LiveDashboard(gate=Gate(host="127.0.0.1", port=0, access=Access()), vehicles=[vehicle])
    try:
        for display, wanted in (("", []), (":0", [dashboard.url])):
            monkeypatch.setenv("DISPLAY", display)
            monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
            assert not await_browser(dashboard, Console(quiet=True), threading.Event(), wait_s=0.2)
            assert opened == wanted
    finally:
        dashboard.close()
