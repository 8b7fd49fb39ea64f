"""Takes the pictures of the pages in `docs/pictures`: `make docs`. They are committed.

A demo flies, in a forest that is always the same, and Chromium looks at it: in flight, on the ground, and at its log
afterwards. Then it looks at a small campaign, at the comparison that is shipped, and at the login. So the pictures
are alike each time, and never the same to the pixel.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

from goshawk_ground.pages.ports import free_port
from PIL import Image
from playwright.sync_api import Browser, Page, expect, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs/pictures"
GOSHAWK = (sys.executable, "-c", "from goshawk_ground.cli import main; main()")
PORT = 8190
"""Pages are served here, or at the next port that is free."""
SEED = 5
"""Of the forest: trees near the way, and room to pass between them."""
DISTANCE_M = "150"
"""The target runs so far: there is time for a picture on a busy machine, too."""
DESKTOP = (1440, 900)
PHONE = (390, 844)
"""CSS pixels, as a phone's browser has them."""
COLORS = 255
"""A picture keeps so many: then it is small, and nobody sees a difference."""
PATIENCE_MS = 120_000
"""A renderer in software draws a frame or two a second."""
SETTLES_MS = 4_000
"""The scene is drawn for so long before a picture is taken."""
FLAGS = (
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--disable-background-networking",
)


class PictureError(RuntimeError):
    """A picture cannot be taken; one line says why and what to do."""


LINK = r"http://127[^\s\x1b]+"
"""A page's address as a command prints it for this machine."""
LINK_FOR_OTHERS = r"https://[^\s\x1b]+"
CAMPAIGN = "fly --seeds tuning --task track --speed 5,7 --spacing 4 --trials 4 --seed 5"
"""What its page shows."""


@contextmanager
def served(*arguments: str, link: str = LINK) -> Generator[str]:
    """The address of the page that a command of `goshawk` serves; the command ends with the block."""
    # As on a terminal a demo waits until somebody looks.
    environment = {**os.environ, "FORCE_COLOR": "1", "COLUMNS": "200"}
    with tempfile.NamedTemporaryFile("w+", encoding="utf-8") as heard:
        command = (*GOSHAWK, *arguments, "--port", str(free_port(PORT)))
        process = subprocess.Popen(command, stdout=heard, stderr=heard, cwd=ROOT, env=environment)
        try:
            while not (found := re.search(link, Path(heard.name).read_text(encoding="utf-8"))):
                if process.poll() is not None:
                    said = Path(heard.name).read_text(encoding="utf-8")
                    raise PictureError(f"goshawk {arguments[0]} showed no page:\n{said}")
                time.sleep(0.1)
            yield found.group()
        finally:
            process.terminate()
            process.wait(timeout=60)


def take(page: Page, name: str) -> None:
    """Writes what a page shows as a small PNG."""
    page.evaluate("for (const n of document.querySelectorAll('.mantine-Notification-root')) n.style.display = 'none'")
    shot = Image.open(io.BytesIO(page.screenshot(timeout=PATIENCE_MS))).convert("RGB")
    shot.quantize(COLORS).save(PICTURES / f"{name}.png", optimize=True)
    print(f"docs/pictures/{name}.png: {shot.width} x {shot.height}")


def visit(browser: Browser, url: str, size: tuple[int, int] = DESKTOP) -> Page:
    """A page of its own."""
    scale = 2 if size == PHONE else 1
    page = browser.new_page(
        viewport={"width": size[0], "height": size[1]}, device_scale_factor=scale, ignore_https_errors=True
    )
    page.set_default_timeout(PATIENCE_MS)
    # viser would draw fewer pixels, for it is slow without a graphics card. This is its own word for all of them.
    whole = f"history.replaceState(null, '', '/?fixedDpr={scale}')"
    page.add_init_script(f"if (location.pathname === '/' && !location.search) {whole}")
    page.goto(url)
    return page


def live(browser: Browser, logs: Path, size: tuple[int, int], kind: str) -> None:
    """The dashboard of a chase, in flight and on the ground; the flight's log stays in ``logs``."""
    with served("demo", "--seed", str(SEED), "--distance", DISTANCE_M, "--log-dir", str(logs)) as url:
        page = visit(browser, url, size)
        status = page.locator('[data-goshawk="status"]').first
        for word, name in (("track", "flight"), ("ready", "ground")):
            expect(status).to_have_attribute("data-mode", word)
            page.wait_for_timeout(SETTLES_MS)
            take(page, f"{kind}-{name}")
            if status.get_attribute("data-mode") != word:
                raise PictureError(f"{kind}-{name}: the flight had gone on before: try again on a machine less busy")
        page.close()


def both(browser: Browser, url: str, name: str) -> None:
    """A page that is no scene, on a desktop and on a phone."""
    for size, prefix in ((DESKTOP, ""), (PHONE, "phone-")):
        page = visit(browser, url, size)
        page.wait_for_timeout(SETTLES_MS)
        take(page, prefix + name)
        page.close()


def afterwards(browser: Browser, logs: Path) -> None:
    """What a log becomes: review, report, and the page over a folder of flights."""
    log = max(logs.rglob("*.mcap"), key=lambda path: path.stat().st_mtime)
    with served("review", str(log)) as url:
        for size, name in ((DESKTOP, "review"), (PHONE, "phone-review")):
            page = visit(browser, url, size)
            page.locator('[data-phase="tracking"]').first.click()
            page.wait_for_timeout(SETTLES_MS)
            take(page, name)
            page.close()
    report, season = logs.with_name("report.html"), logs.with_name("season.html")
    for command in (("report", str(log), "-o", str(report)), ("logs", logs.name, "--report", str(season))):
        subprocess.run((*GOSHAWK, *command), check=True, capture_output=True, cwd=logs.parent)
    both(browser, report.as_uri(), "report")
    both(browser, season.as_uri(), "season")


def campaigns(browser: Browser, folder: Path) -> None:
    """A campaign's page, and the comparison of two pilots."""
    flown, drawn = folder / "campaign.json", folder / "campaign.html"
    simulator = (ROOT / "target/release/goshawk-sim", *CAMPAIGN.split(), "--json", flown)
    for command in (simulator, (*GOSHAWK, "campaign", "report", str(flown))):
        subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
    both(browser, drawn.as_uri(), "campaign")
    both(browser, (ROOT / "docs/learned-against-classical.html").as_uri(), "comparison")


def login(browser: Browser) -> None:
    """What another machine's browser is shown first."""
    with served("ground", "--host", "0.0.0.0", link=LINK_FOR_OTHERS) as url:
        both(browser, urlsplit(url)._replace(path="/", query="", fragment="").geturl(), "login")


def main() -> int:
    """Takes all of them; exit status 1 with one line if it cannot."""
    chromium = shutil.which("chromium")
    if chromium is None:
        print("docs/pictures.py: chromium is missing: install it (apt-get install chromium)", file=sys.stderr)
        return 1
    PICTURES.mkdir(exist_ok=True)
    expect.set_options(timeout=PATIENCE_MS)
    with tempfile.TemporaryDirectory(prefix="goshawk-pictures-") as folder, sync_playwright() as playwright:
        # At a low priority: the renderer must not starve the flight beside it.
        nice = Path(folder, "chromium")
        nice.write_text(f'#!/bin/sh\nexec nice -n 15 {chromium} "$@"\n', encoding="utf-8")
        nice.chmod(0o755)
        browser = playwright.chromium.launch(executable_path=nice, args=FLAGS)
        logs = Path(folder, "logs")
        try:
            live(browser, logs, DESKTOP, "live")
            live(browser, logs, PHONE, "phone")
            afterwards(browser, logs)
            campaigns(browser, Path(folder))
            login(browser)
        except PictureError as error:
            print(f"docs/pictures.py: {error}", file=sys.stderr)
            return 1
        finally:
            browser.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
