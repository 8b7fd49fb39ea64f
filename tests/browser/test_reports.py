"""A campaign's page and a flight's in a real browser: wide and narrow, light and dark; a flight's charts zoom."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
import recordings as rec
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.campaign.data import load
from goshawk_dashboards.report.campaign.page import page as campaign_page
from goshawk_dashboards.report.campaign.report import make_campaign_report
from goshawk_dashboards.report.report import make_report, write_page
from playwright.sync_api import Browser, Page, expect

ROOT = Path(__file__).resolve().parents[2]
CHASE = ["--task", "track", "--speed", "4,14", "--spacing", "3", "--trials", "1", "--seed", "3"]


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a small campaign."""
    flown = tmp_path_factory.mktemp("chase") / "flown.json"
    command = [str(ROOT / "target/release/goshawk-sim"), "fly", *CHASE, "--json", str(flown)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    out = flown.with_suffix(".html")
    out.write_text(campaign_page(make_campaign_report(load(flown))), encoding="utf-8")
    return out


def opened(browser: Browser, file: Path, width: int, theme: str) -> Page:
    """The page, in a window so wide."""
    tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=theme)  # type: ignore[arg-type]
    tab.goto(file.as_uri())
    return tab


@pytest.mark.parametrize("width", [360, 800, 1400])
def test_the_page_never_scrolls_sideways_and_every_figure_has_room(browser: Browser, file: Path, width: int) -> None:
    tab = opened(browser, file, width, "light")
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    sizes = tab.evaluate("[...document.querySelectorAll('svg')].map(s => s.getBoundingClientRect().toJSON())")
    assert len(sizes) >= 13
    assert all(size["width"] >= 300 and size["height"] > 80 for size in sizes)
    tab.close()


def test_figures_stand_in_pairs_where_there_is_room_for_two(browser: Browser, file: Path) -> None:
    def first_two(width: int) -> list[float]:
        tab = opened(browser, file, width, "light")
        found = tab.evaluate("[...document.querySelectorAll('.grid figure')].slice(0, 2).map(f => f.offsetTop)")
        tab.close()
        return found

    wide, narrow = first_two(1400), first_two(500)
    assert wide[0] == wide[1] and narrow[0] < narrow[1]


def test_words_and_lines_of_the_figures_follow_the_readers_theme(browser: Browser, file: Path) -> None:
    def brightness(theme: str) -> tuple[float, float]:
        """Of a figure's words and of what is behind them."""
        tab = opened(browser, file, 1200, theme)
        color = "(e, what) => getComputedStyle(e)[what].match(/[0-9.]+/g).slice(0, 3).map(Number)"
        words = tab.evaluate(f"({color})(document.querySelector('svg text'), 'fill')")
        paper = tab.evaluate(f"({color})(document.querySelector('.panel'), 'backgroundColor')")
        tab.close()
        return sum(words) / 3, sum(paper) / 3

    light, dark = brightness("light"), brightness("dark")
    assert light[0] < light[1] - 80 and dark[0] > dark[1] + 80


def test_the_page_asks_for_nothing_but_itself(browser: Browser, file: Path) -> None:
    tab = browser.new_page()
    asked: list[str] = []
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto(file.as_uri())
    assert asked == [file.as_uri()]
    tab.close()


@pytest.fixture(scope="module")
def flight_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a made-up flight."""
    folder = tmp_path_factory.mktemp("flight")
    write_page(make_report(Flight.open(rec.write_flight(folder / "flight.mcap"))), folder / "flight.html")
    return folder / "flight.html"


def test_a_flights_charts_zoom_together_tell_values_and_ask_for_nothing(browser: Browser, flight_page: Path) -> None:
    tab = browser.new_page(viewport={"width": 1200, "height": 1100})
    asked, errors = list[str](), list[str]()
    tab.on("request", lambda request: asked.append(request.url))
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto(flight_page.as_uri())
    tab.locator("#charts").scroll_into_view_if_needed()
    box = tab.locator("#charts .u-over").first.bounding_box()
    assert box is not None
    speed = tab.locator('#charts [data-line="speed"] output').first
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 10)
    expect(speed).to_have_text(re.compile(r"^4\.\d\d m/s$"))
    tab.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 10)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20, steps=4)
    tab.mouse.up()
    windows = tab.evaluate("goshawkReport.charts.map(({ plot }) => [plot.scales.x.min, plot.scales.x.max])")
    assert len(windows) >= 8
    assert all(window == pytest.approx([2.0, 4.0], abs=0.1) for window in windows)
    tab.locator('#charts [data-line="speed"] button').first.click()
    assert tab.evaluate("goshawkReport.charts[0].plot.series[1].show") is False
    assert (asked, errors) == ([flight_page.as_uri()], [])
    tab.close()


@pytest.mark.parametrize("width", [360, 1200])
def test_a_flights_page_never_scrolls_sideways(browser: Browser, flight_page: Path, width: int) -> None:
    tab = opened(browser, flight_page, width, "dark")
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    tab.close()
