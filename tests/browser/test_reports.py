"""A campaign's page and a flight's in a real browser: wide and narrow, light and dark; a flight's charts zoom."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
import recordings as rec
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.campaign.data import load
from goshawk_dashboards.report.campaign.page import page as campaign_page
from goshawk_dashboards.report.campaign.report import make_campaign_report
from goshawk_dashboards.report.report import make_report, write_page
from playwright.sync_api import Browser, Page, expect
from stage import Seen

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


Opened = Callable[[Path, int, str], Page]


@pytest.fixture
def opened(browser: Browser, watch: Callable[[Page], Seen]) -> Opened:
    """Opens a page in a window so wide, in a theme."""

    def open_page(file: Path, width: int, theme: str) -> Page:
        tab = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=theme)  # type: ignore[arg-type]
        watch(tab)
        tab.goto(file.as_uri())
        return tab

    return open_page


@pytest.mark.parametrize("width", [360, 800, 1400])
def test_the_page_never_scrolls_sideways_and_every_figure_has_room(opened: Opened, file: Path, width: int) -> None:
    tab = opened(file, width, "light")
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    sizes = tab.evaluate("[...document.querySelectorAll('svg')].map(s => s.getBoundingClientRect().toJSON())")
    assert len(sizes) >= 13
    assert all(size["width"] >= 300 and size["height"] > 80 for size in sizes)
    tab.close()


def test_figures_stand_in_pairs_where_there_is_room_for_two(opened: Opened, file: Path) -> None:
    def first_two(width: int) -> list[float]:
        tab = opened(file, width, "light")
        found = tab.evaluate("[...document.querySelectorAll('.grid figure')].slice(0, 2).map(f => f.offsetTop)")
        tab.close()
        return found

    wide, narrow = first_two(1400), first_two(500)
    assert wide[0] == wide[1] and narrow[0] < narrow[1]


def test_words_and_lines_of_the_figures_follow_the_readers_theme(opened: Opened, file: Path) -> None:
    def brightness(theme: str) -> tuple[float, float]:
        """Of a figure's words and of what is behind them."""
        tab = opened(file, 1200, theme)
        color = "(e, what) => getComputedStyle(e)[what].match(/[0-9.]+/g).slice(0, 3).map(Number)"
        words = tab.evaluate(f"({color})(document.querySelector('svg text'), 'fill')")
        paper = tab.evaluate(f"({color})(document.querySelector('.panel'), 'backgroundColor')")
        tab.close()
        return sum(words) / 3, sum(paper) / 3

    light, dark = brightness("light"), brightness("dark")
    assert light[0] < light[1] - 80 and dark[0] > dark[1] + 80


def test_the_page_asks_for_nothing_but_itself(browser: Browser, watch: Callable[[Page], Seen], file: Path) -> None:
    seen = watch(browser.new_page())
    seen.page.goto(file.as_uri())
    assert seen.requests == [file.as_uri()]
    seen.page.close()


@pytest.fixture(scope="module")
def flight_page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a made-up flight."""
    folder = tmp_path_factory.mktemp("flight")
    write_page(make_report(Flight.open(rec.write_flight(folder / "flight.mcap"))), folder / "flight.html")
    return folder / "flight.html"


def test_a_flights_charts_zoom_together_tell_values_and_ask_for_nothing(
    browser: Browser, watch: Callable[[Page], Seen], flight_page: Path
) -> None:
    seen = watch(browser.new_page(viewport={"width": 1200, "height": 1100}))
    tab = seen.page
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
    # What is no number is no part of what an axis shows.
    gaps = "{hidden: new Set(), lines: [{unit: 'm', key: 'a', t: [0, 1, 2, 3, 4], v: [null, 4, NaN, 5, undefined]}]}"
    span = tab.evaluate(f"GoshawkCharts.prototype.range.call({{window: [0, 9]}}, {gaps}, 'm')")
    assert (span["min"], span["max"]) == (pytest.approx(3.94), pytest.approx(5.06))
    assert seen.requests == [flight_page.as_uri()]
    tab.close()


@pytest.mark.parametrize("width", [360, 1200])
def test_a_flights_page_never_scrolls_sideways(opened: Opened, flight_page: Path, width: int) -> None:
    tab = opened(flight_page, width, "dark")
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    tab.close()


def test_an_error_in_a_pages_console_is_heard_unless_the_test_expects_it(
    browser: Browser, watch: Callable[..., Seen]
) -> None:
    seen = watch(browser.new_page(), expected="of no harm")
    seen.page.evaluate("console.error('one of no harm'); console.warn('a warning'); console.error('a broken page')")
    seen.page.evaluate("setTimeout(() => { throw new Error('a broken script') })")
    seen.page.wait_for_timeout(200)
    seen.page.close()
    assert seen.errors == ["a broken page", "a broken script"]
    seen.errors.clear()  # else this test would fail at its end, as any other one would
