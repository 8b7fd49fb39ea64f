"""Real Chromium, on the machine's own renderer in software, against a real ground station."""

from __future__ import annotations

import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from goshawk_dashboards.live import LiveDashboard
from goshawk_ground.link import GroundLink
from goshawk_ground.serve import serve_dashboard
from playwright.sync_api import Browser, Page, expect, sync_playwright

FAKE = Path(__file__).with_name("fake_vehicle.py")
FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
]


# The software renderer of a busy machine draws a frame or two a second.
expect.set_options(timeout=60_000)


def free_port() -> int:
    """A TCP port that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """One Chromium for all tests."""
    chromium = shutil.which("chromium")
    assert chromium is not None, "chromium is missing: `make setup-test` installs it"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        yield browser
        browser.close()


@dataclass(kw_only=True)
class Visit:
    """A page and what it did behind the scenes."""

    page: Page
    requests: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)


@pytest.fixture
def visit(browser: Browser) -> Iterator[Callable[[str], Visit]]:
    """Opens an address in a fresh page, small, for the software renderer's sake."""
    pages: list[Page] = []

    def open_page(url: str) -> Visit:
        page = browser.new_page(viewport={"width": 1100, "height": 640})
        pages.append(page)
        page.set_default_timeout(60_000)
        seen = Visit(page=page)
        page.on("request", lambda request: seen.requests.append(request.url))
        page.on("pageerror", lambda error: seen.errors.append(str(error)))
        page.goto(url)
        return seen

    yield open_page
    for page in pages:
        page.close()


@dataclass(kw_only=True)
class Ground:
    """A stand-in vehicle, and a ground station in this process so that its scene can be read."""

    vehicle: subprocess.Popen[str]
    link: GroundLink
    dashboard: LiveDashboard


@pytest.fixture
def ground() -> Iterator[Callable[..., Ground]]:
    """Starts a stand-in vehicle with the given flags, and a ground station for it."""
    started: list[Ground] = []

    def start(*flags: str) -> Ground:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        vehicle = subprocess.Popen(
            [sys.executable, str(FAKE), "--listen", endpoint, *flags], stdout=subprocess.PIPE, text=True
        )
        assert vehicle.stdout is not None
        assert vehicle.stdout.readline() == "listening\n"
        link = GroundLink(connect=endpoint)
        ground = Ground(vehicle=vehicle, link=link, dashboard=serve_dashboard(link, host="127.0.0.1", port=free_port()))
        started.append(ground)
        return ground

    yield start
    for ground in started:
        ground.dashboard.close()
        ground.link.close()
        ground.vehicle.terminate()
        ground.vehicle.wait(timeout=10)
        if ground.vehicle.stdout is not None:
            ground.vehicle.stdout.close()
