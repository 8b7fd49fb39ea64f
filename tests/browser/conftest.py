"""Real Chromium, on the machine's own renderer in software, against a real ground station."""

from __future__ import annotations

import io
import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from goshawk_ground.link import GroundLink
from goshawk_ground.pages.serve import serve_dashboard
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright
from stage import Ground, Seen

FAKE = Path(__file__).with_name("fake_vehicle.py")
FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
]


NO_SCENE = """for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced"])
  WebGL2RenderingContext.prototype[name] = () => {};
window.requestAnimationFrame = (callback) => setTimeout(() => callback(performance.now()), 250);"""
"""The 3-D view stays empty, and is left so: what is beside it answers at once."""

# The software renderer of a busy machine draws a frame or two a second.
expect.set_options(timeout=60_000)


def free_port() -> int:
    """A TCP port that was free a moment ago."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One Chromium for all tests, at a low priority: its renderer in software must not starve a flight beside it."""
    chromium = shutil.which("chromium")
    assert chromium is not None, "chromium is missing: `make setup-test` installs it"
    nice = tmp_path_factory.mktemp("browser") / "chromium"
    nice.write_text(f'#!/bin/sh\nexec nice -n 15 {chromium} "$@"\n')
    nice.chmod(0o755)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=nice, args=FLAGS)
        yield browser
        browser.close()


class Look:
    """What the 3-D view shows, in pixels."""

    @staticmethod
    def picture(page: Page) -> np.ndarray:
        """The middle of the page, between the panels: height x width x RGB."""
        view = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB")).astype(int)
        return view[150:, 350:740]

    @staticmethod
    def flown_green(view: np.ndarray) -> int:
        """How many pixels have the colour of the trajectory that is flown."""
        red, green, blue = view[..., 0], view[..., 1], view[..., 2]
        return int(((green > 90) & (green > 1.5 * red) & (green > 1.15 * blue)).sum())

    @staticmethod
    def changed_fraction(before: np.ndarray, after: np.ndarray) -> float:
        """Share of the pixels that differ clearly."""
        return float((np.abs(before - after).max(axis=-1) > 30).mean())


@pytest.fixture
def look() -> type[Look]:
    """How to read the picture."""
    return Look


@pytest.fixture
def watch() -> Iterator[Callable[..., Seen]]:
    """Listens to a page. At the end no page may have had an error."""
    watched: list[Seen] = []

    def listen(page: Page, expected: str = r"(?!)") -> Seen:
        """``expected`` matches the errors that the test brings about."""
        seen = Seen(page=page)

        def hear(text: str) -> None:
            if not re.search(expected, text):
                seen.errors.append(text)

        page.on("request", lambda request: seen.requests.append(request.url))
        page.on("pageerror", lambda error: hear(str(error)))
        page.on("console", lambda message: hear(message.text) if message.type == "error" else None)
        watched.append(seen)
        return seen

    yield listen
    assert [error for seen in watched for error in seen.errors] == []


@pytest.fixture
def visit(browser: Browser, watch: Callable[..., Seen]) -> Iterator[Callable[..., Seen]]:
    """Opens an address in a fresh page, small, for the software renderer's sake."""
    pages: list[Page] = []

    def open_page(url: str, width: int = 1100, height: int = 640, *, scene: bool = True) -> Seen:
        page = browser.new_page(viewport={"width": width, "height": height})
        if not scene:
            page.add_init_script(NO_SCENE)
        pages.append(page)
        page.set_default_timeout(60_000)
        seen = watch(page)
        page.goto(url)
        return seen

    yield open_page
    for page in pages:
        page.close()


def start_vehicle(name: str, *flags: str) -> tuple[subprocess.Popen[str], GroundLink]:
    """A stand-in vehicle that listens, and a link to it."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, str(FAKE), "--listen", endpoint, "--vehicle", name, *flags]
    vehicle = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert vehicle.stdout is not None
    assert vehicle.stdout.readline() == "listening\n"
    return vehicle, GroundLink(vehicle=name, connect=endpoint)


def end(process: subprocess.Popen[str]) -> None:
    """Politely, then for good: what is left running would take the next test's time."""
    process.terminate()
    try:
        process.wait(timeout=10)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@pytest.fixture
def ground() -> Iterator[Callable[..., Ground]]:
    """Starts stand-in vehicles with the given flags, one a name, and a ground station for them."""
    started: list[Ground] = []

    def start(*flags: str, names: tuple[str, ...] = ("goshawk",)) -> Ground:
        (vehicle, link), *others = (start_vehicle(name, *flags) for name in names)
        links = [link, *(other for _, other in others)]
        dashboard = serve_dashboard(*links, host="127.0.0.1", port=free_port())
        ground = Ground(vehicle=vehicle, link=link, dashboard=dashboard, others=others)
        started.append(ground)
        return ground

    yield start
    for ground in started:
        ground.dashboard.close()
        for vehicle, link in ((ground.vehicle, ground.link), *ground.others):
            link.close()
            end(vehicle)
            if vehicle.stdout is not None:
                vehicle.stdout.close()


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Callable[..., tuple[subprocess.Popen[str], dict[str, Any]]]]:
    """Starts `goshawk ground` as a process; it and what it printed."""
    started: list[subprocess.Popen[str]] = []

    def start(*options: str) -> tuple[subprocess.Popen[str], dict[str, Any]]:
        command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", "ground", "--json", *options]
        environment = {**os.environ, "XDG_CONFIG_HOME": str(tmp_path / "config")}
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
        started.append(process)
        assert process.stdout is not None
        return process, json.loads(process.stdout.readline())

    yield start
    for process in started:
        process.send_signal(signal.SIGINT)
        process.wait(timeout=30)
        if process.stdout is not None:
            process.stdout.close()
