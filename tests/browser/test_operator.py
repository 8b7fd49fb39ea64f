"""What an operator relies on: Stop within reach whatever the page does, alerts, and several vehicles."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from goshawk_ground.pages.ports import free_port
from goshawk_proto import goshawk_pb2 as pb
from playwright.sync_api import Page, expect
from stage import Ground, Seen

Start = Callable[..., Ground]
Visit = Callable[..., Seen]


@pytest.fixture
def visit(visit: Callable[..., Seen]) -> Visit:
    """A page whose scene is not drawn: what is pressed and said here is about everything else, and a software renderer
    takes most of a machine for the scene. `test_dashboard.py` looks for Stop over a scene that is drawn."""
    return partial(visit, scene=False)


def flying(g: Ground) -> None:
    """Takes off, and waits until it tracks."""
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
    assert g.link.start().accepted
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_TRACK, 20)


def reachable(page: Page, name: str) -> None:
    """The button is in the window, and nothing lies over its middle."""
    button = page.get_by_role("button", name=name, exact=True)
    expect(button).to_be_in_viewport(ratio=1)
    on_top = button.evaluate(
        "b => {const r = b.getBoundingClientRect();"
        "return b.contains(document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2))}"
    )
    assert on_top, f"something lies over {name}"


def point_at(page: Page, selector: str) -> str:
    """Moves the mouse onto it, and reads what the page noted."""
    x, y = page.evaluate(
        "selector => {const r = document.querySelector(selector)?.getBoundingClientRect();"
        "return r ? [r.x + r.width / 2, r.y + 8] : [0, 0]}",
        selector,
    )
    page.mouse.move(0, 0)
    page.mouse.move(x, y)
    return page.evaluate("window.words ?? ''")


def test_the_stop_key_stops_even_while_an_input_has_the_focus(ground: Start, visit: Visit) -> None:
    g = ground()
    flying(g)
    page = visit(g.dashboard.url).page
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    # viser's own hotkeys do nothing while an input field has the focus. In flight the page may have none.
    page.evaluate("document.body.appendChild(document.createElement('input')).focus()")
    assert page.evaluate("document.activeElement.tagName") == "INPUT"
    page.keyboard.press("Space")
    assert g.link.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 20)
    expect(page.locator('[data-goshawk="toast"]')).to_contain_text("vehicle confirms stop")


def test_stop_stays_within_reach_when_the_panel_is_scrolled_and_on_a_phone(ground: Start, visit: Visit) -> None:
    g = ground()
    flying(g)
    page = visit(g.dashboard.url).page
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    # What is in the panel is replaced several times a second: the mouse goes there by its place.
    size = page.viewport_size
    assert size is not None
    page.mouse.move(size["width"] - 100, size["height"] / 2)
    page.mouse.wheel(0, 2000)
    expect(page.locator('[data-goshawk="events"]')).to_be_in_viewport()
    reachable(page, "Stop")

    phone = visit(g.dashboard.url, width=390, height=844).page
    card = phone.locator('[data-goshawk="phone"] [data-goshawk="status"]')
    expect(card).to_have_attribute("data-mode", "track")
    reachable(phone, "Stop")
    phone.get_by_text("Goshawk", exact=True).click()  # moves the sheet
    expect(card).to_be_visible()
    reachable(phone, "Stop")
    phone.get_by_role("button", name="Stop", exact=True).click()
    assert g.link.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 20)


def mode_is_seen_beside(page: Page, selector: str) -> bool:
    """Whether a phone shows what the selector finds, and nothing lies over the mode's pill.

    The layer lets touches through, so that no point of it would be found: meanwhile it takes them.
    """
    return page.evaluate(
        """selector => {
          const style = document.createElement("style");
          style.textContent = "#goshawk-over, #goshawk-over * { pointer-events: auto !important }"
            + "#goshawk-over .goshawk-edge { pointer-events: none !important }";
          document.head.append(style);
          const pill = document.querySelector('[data-goshawk="phone"] [data-goshawk="status"] span');
          const box = pill.getBoundingClientRect(), news = document.querySelector(selector).getBoundingClientRect();
          const seen = [0.1, 0.5, 0.9].map((part) =>
            document.elementFromPoint(box.x + part * box.width, box.y + box.height / 2));
          style.remove();
          return news.height > 0 && seen.every((element) => pill.contains(element));
        }""",
        selector,
    )


def test_on_a_phone_neither_a_commands_outcome_nor_an_alert_lies_over_the_mode(ground: Start, visit: Visit) -> None:
    g = ground()
    flying(g)
    page = visit(g.dashboard.url, width=390, height=844).page
    expect(page.locator('[data-goshawk="phone"] [data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    page.get_by_role("button", name="Stop", exact=True).click()
    expect(page.locator('[data-goshawk="toast"]')).to_contain_text("vehicle confirms stop")
    assert mode_is_seen_beside(page, '[data-goshawk="toast"]')
    g.vehicle.kill()
    expect(page.locator('[data-goshawk="alerts"]')).to_contain_text("VEHICLE SILENT")
    assert mode_is_seen_beside(page, ".goshawk-alert")


def test_a_vehicle_that_falls_silent_in_flight_is_an_alert_and_a_ghost(ground: Start, visit: Visit) -> None:
    g = ground()
    flying(g)
    page = visit(g.dashboard.url).page
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    expect(page.locator('[data-goshawk="edge"]')).to_have_count(0)
    g.vehicle.kill()
    expect(page.locator('[data-goshawk="alerts"]')).to_contain_text("VEHICLE SILENT")
    expect(page.locator('[data-goshawk="edge"]')).to_be_visible()
    (view,) = g.dashboard.views
    assert view.scene.ghost.visible
    assert not view.scene.model.visible


def test_candidates_are_ranked_with_reasons_and_say_their_cost_under_the_mouse(ground: Start, visit: Visit) -> None:
    g = ground()
    flying(g)
    page = visit(g.dashboard.url).page
    strip = page.locator('[data-goshawk="strip"]')
    expect(strip.locator("[data-candidate]")).to_have_count(15)
    expect(strip.locator("[data-candidate]").first).to_have_attribute("data-rejection", "none")
    expect(strip.locator("[data-candidate]:not([data-rejection=none])").first).to_be_attached()
    # The strip is replaced five times a second, more often than a page without a graphics card is painted: the page
    # itself looks what is shown as the mouse moves.
    page.evaluate(
        "() => document.addEventListener('mousemove', () => {"
        "const tip = document.querySelector('[data-goshawk=strip] :hover > .goshawk-tip');"
        "if (tip && getComputedStyle(tip).display == 'block') window.words = tip.textContent})"
    )
    deadline = time.monotonic() + 60
    while "cost" not in point_at(page, "[data-goshawk=strip] [data-candidate]"):
        assert time.monotonic() < deadline, "no words under the mouse"


def test_several_vehicles_are_seen_at_once_and_each_and_all_can_be_stopped(ground: Start, visit: Visit) -> None:
    g = ground(names=("alpha", "bravo", "charlie"))
    links = [g.link, *(link for _, link in g.others)]
    for link in links:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
        assert link.start().accepted
    for link in links:
        assert link.wait_for(lambda s: s.mode == pb.MODE_TRACK, 20)
    page = visit(g.dashboard.url, height=900).page
    rows = page.locator('[data-goshawk="fleet"] [data-vehicle]')
    expect(rows).to_have_count(3)
    expect(page.locator('[data-goshawk="fleet"] [data-mode="track"]')).to_have_count(3)
    reachable(page, "Stop alpha")

    page.get_by_role("button", name="Show", exact=True).nth(1).click()
    reachable(page, "Stop bravo")
    expect(page.locator('[data-vehicle="bravo"]')).to_have_attribute("data-shown", "true")
    page.keyboard.press("Space")
    assert links[1].wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 20)
    assert [links[0].snapshot().mode, links[2].snapshot().mode] == [pb.MODE_TRACK, pb.MODE_TRACK]

    reachable(page, "Stop all")
    page.get_by_role("button", name="Stop all", exact=True).click()
    expect(page.get_by_role("button", name="Press again: all stop")).to_be_visible()
    assert [links[0].snapshot().mode, links[2].snapshot().mode] == [pb.MODE_TRACK, pb.MODE_TRACK]
    # A busy machine may take longer to click once more than the first press counts.
    expect(page.get_by_role("button", name="Stop all", exact=True)).to_be_visible()
    page.evaluate("const all = document.querySelector('.goshawk-all'); all.click(); all.click()")
    for link in links:
        assert link.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 20)


def test_space_stops_only_what_this_browser_shows(ground: Start, visit: Visit) -> None:
    g = ground(names=("alpha", "bravo"))
    links = [g.link, g.others[0][1]]
    for link in links:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
        assert link.start().accepted
    for link in links:
        assert link.wait_for(lambda s: s.mode == pb.MODE_TRACK, 20)
    one, two = visit(g.dashboard.url).page, visit(g.dashboard.url).page
    reachable(one, "Stop alpha")
    reachable(two, "Stop alpha")
    two.keyboard.press("2")
    reachable(two, "Stop bravo")
    reachable(one, "Stop alpha")

    one.keyboard.press("Space")
    assert links[0].wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 20)
    expect(one.locator('[data-goshawk="toast"]')).to_contain_text("vehicle confirms stop")
    assert links[1].snapshot().mode == pb.MODE_TRACK
    command = links[1].snapshot().command
    assert command is not None and command.verb == "start"
    two.keyboard.press("Space")
    assert links[1].wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 20)


def test_a_tab_that_is_loaded_again_shows_the_vehicle_that_it_showed(ground: Start, visit: Visit) -> None:
    g = ground(names=("alpha", "bravo"))
    page = visit(g.dashboard.url).page
    page.get_by_role("button", name="Show", exact=True).nth(1).click()
    reachable(page, "Stop bravo")
    page.reload()
    reachable(page, "Stop bravo")
    other = visit(g.dashboard.url).page
    reachable(other, "Stop alpha")


def test_shift_and_space_stop_all_only_when_pressed_twice(ground: Start, visit: Visit) -> None:
    g = ground(names=("alpha", "bravo"))
    links = [g.link, g.others[0][1]]
    page = visit(g.dashboard.url).page
    reachable(page, "Stop all")
    again = page.get_by_role("button", name="Press again: all stop")
    deadline = time.monotonic() + 60
    while True:  # a page that is just being built may not listen yet; 6 s later a press is a first one again
        page.keyboard.press("Shift+Space")
        with contextlib.suppress(AssertionError):
            expect(again).to_be_visible(timeout=6000)
            break
        assert time.monotonic() < deadline, "one press did not ask for another"
    assert [link.snapshot().command for link in links] == [None, None]
    # The first press is forgotten after a few seconds.
    expect(page.get_by_role("button", name="Stop all", exact=True)).to_be_visible()
    page.keyboard.press("Shift+Space")
    page.keyboard.press("Shift+Space")
    for link in links:
        assert link.wait_for(lambda s: s.command is not None and s.command.verb == "stop" and s.command.accepted, 20)


def test_a_viewer_without_commands_has_no_button_and_no_key(ground: Start, visit: Visit) -> None:
    g = ground()
    page = visit(g.dashboard.observer_url).page
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "ready")
    for name in ("Start", "Stop"):
        expect(page.get_by_role("button", name=name, exact=True)).to_have_count(0)
    page.keyboard.press("Space")
    page.keyboard.press("Shift+Space")
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "ready")
    assert g.link.snapshot().command is None


def test_a_page_that_hears_nothing_any_more_says_so(
    ground: Start, station: Callable[..., tuple[subprocess.Popen[str], dict[str, Any]]], visit: Callable[..., Seen]
) -> None:
    vehicle = ground()
    listens = f"goshawk@{vehicle.link.connect}"
    process, printed = station("--port", str(free_port(8097)), "--vehicle", listens)
    page = visit(printed["url"]).page
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "ready")
    still = page.locator(".goshawk-still")
    expect(still).to_be_hidden()
    process.send_signal(signal.SIGSTOP)
    try:
        expect(still).to_contain_text("what is shown is old")
    finally:
        process.send_signal(signal.SIGCONT)
    expect(still).to_be_hidden()
