"""The live dashboard in a real browser: it draws what the vehicle considers, and its buttons fly."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any
from urllib.parse import urlparse

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from playwright.sync_api import Page, expect
from stage import Ground, Seen

Start = Callable[..., Ground]
Visit = Callable[[str], Seen]


def mode(page: Page, name: str) -> None:
    """Waits until the page shows a mode."""
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", name)


def press_start(page: Page, confirm: str) -> None:
    """Start, then the answer to its question."""
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_role("button", name=confirm, exact=True).click()


def test_start_flies_stop_lands_and_candidates_move_meanwhile(ground: Start, visit: Visit, look: Any) -> None:
    g = ground()
    seen = visit(g.dashboard.url)
    page = seen.page
    mode(page, "ready")
    assert g.dashboard.views[0].scene.candidates.count == 0, "a plan is drawn before there is one"
    # The edges of a label have a few pixels of that colour too: more or less, as they are drawn.
    at_rest = look.flown_green(look.picture(page))
    press_start(page, "Start now")
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_TAKEOFF, 10)
    mode(page, "track")
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.plan is not None, 10)

    deadline = time.monotonic() + 60
    while look.flown_green(look.picture(page)) < at_rest + 60:
        assert time.monotonic() < deadline, "the chosen trajectory was never seen"
    scene = g.dashboard.views[0].scene
    points, place = np.array(scene.chosen.curve_S3), np.array(scene.candidates.root.position)
    before = look.picture(page)
    time.sleep(1.0)
    after = look.picture(page)
    assert scene.candidates.count == 15
    assert not np.array_equal(points, scene.chosen.curve_S3)
    assert np.linalg.norm(np.asarray(scene.candidates.root.position) - place) > 1.0
    assert look.changed_fraction(before, after) > 0.005, "the picture stood still"

    def drawn() -> bool:
        return scene.remembered.faces.count > 0

    page.get_by_text("Candidates", exact=True).click()
    expect(page.locator('[data-goshawk="parts"]')).to_contain_text("+0.25 obstacle")
    expect(page.locator('[data-goshawk="parts"]')).to_contain_text("dearer than the one flown")
    expect(page.locator('[data-goshawk="accelerations"]')).to_contain_text("true")
    assert drawn(), "what is remembered is not drawn"
    page.get_by_text("View", exact=True).click()
    page.get_by_label("Remembered obstacles").dispatch_event("click")
    deadline = time.monotonic() + 60
    while drawn():
        assert time.monotonic() < deadline, "the toggle hid nothing"
        time.sleep(0.05)

    page.get_by_role("button", name="Stop", exact=True).click()
    mode(page, "landed")
    assert g.link.snapshot().mode == pb.MODE_LANDED
    assert seen.errors == []
    assert {urlparse(u).hostname for u in seen.requests if u.startswith("http")} == {"127.0.0.1"}


def test_what_the_controller_has_learnt_is_among_the_instruments(ground: Start, visit: Visit) -> None:
    g = ground()
    page = visit(g.dashboard.url).page
    mode(page, "ready")
    expect(page.locator('[data-goshawk="learnt"]')).to_contain_text("31.4 %")
    expect(page.locator('[data-goshawk="learnt"]')).to_contain_text("84 ms")


def test_start_asks_first_and_shows_what_is_not_ready(ground: Start, visit: Visit) -> None:
    g = ground("--not-ready")
    page = visit(g.dashboard.url).page
    mode(page, "idle")
    expect(page.locator('[data-goshawk="readiness"]')).to_contain_text("no odometry yet")
    page.get_by_role("button", name="Start", exact=True).click()
    modal = page.get_by_role("dialog")
    expect(modal).to_contain_text("odometry: no odometry yet")
    modal.get_by_role("button", name="Cancel").click()
    expect(modal).to_be_hidden()
    assert g.link.snapshot().command is None
    press_start(page, "Start anyway")
    expect(page.locator('[data-goshawk="command"]')).to_contain_text("start refused")
    assert g.link.snapshot().mode == pb.MODE_IDLE


def test_without_a_heartbeat_there_is_nothing_to_start(ground: Start, visit: Visit) -> None:
    g = ground()
    page = visit(g.dashboard.url).page
    mode(page, "ready")
    g.vehicle.kill()
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-stale", "true")
    page.get_by_role("button", name="Start", exact=True).click()
    modal = page.get_by_role("dialog")
    expect(modal).to_contain_text("goshawk cannot be started")
    expect(modal).to_contain_text("The vehicle is silent")
    expect(modal.get_by_role("button", name="Start")).to_have_count(0)
    modal.get_by_role("button", name="Close").click()
    expect(modal).to_be_hidden()
    assert g.link.snapshot().command is None


def test_a_vehicle_of_another_protocol_can_only_be_stopped(ground: Start, visit: Visit) -> None:
    g = ground("--protocol", "0")
    page = visit(g.dashboard.url).page
    mode(page, "ready")
    expect(page.locator('[data-goshawk="alerts"]')).to_contain_text("only Stop works: goshawk speaks protocol 0")
    expect(page.get_by_role("button", name="Start", exact=True)).to_be_hidden()
    assert "Update the vehicle" in g.link.start().text
    assert g.link.snapshot().mode == pb.MODE_READY
    page.keyboard.press("Space")
    expect(page.locator('[data-goshawk="toast"]')).to_contain_text("vehicle confirms stop")


def test_a_silent_vehicle_is_marked_stale_and_stop_still_answers(ground: Start, visit: Visit) -> None:
    g = ground()
    page = visit(g.dashboard.url).page
    mode(page, "ready")
    g.vehicle.kill()
    status = page.locator('[data-goshawk="status"]')
    expect(status).to_have_attribute("data-stale", "true")
    expect(status).to_contain_text("STALE")
    expect(page.locator('[data-goshawk="link"]')).to_contain_text("no link")
    stop = page.get_by_role("button", name="Stop", exact=True)
    expect(stop).to_be_enabled()
    stop.click()
    expect(page.locator('[data-goshawk="alerts"]')).to_contain_text("STOP PENDING")
    expect(page.locator('[data-goshawk="alerts"]')).to_contain_text("Pilot: take over.")


def test_stop_is_in_the_window_and_on_top_at_every_size_and_a_phone_shows_the_picture(
    ground: Start, visit: Callable[..., Seen]
) -> None:
    g = ground()
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_READY, 10)
    assert g.link.start().accepted
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.plan is not None, 10)
    page = visit(g.dashboard.url, 390, 844).page
    expect(page.locator('[data-goshawk="phone"] [data-goshawk="picture"] img')).to_be_visible()
    expect(page.locator('[data-goshawk="phone"] [data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    for width, height in ((390, 844), (844, 390), (1280, 720)):
        page.set_viewport_size({"width": width, "height": height})
        stop = page.locator(".goshawk-one")
        expect(stop).to_be_in_viewport(ratio=1.0)
        box = stop.bounding_box()
        assert box is not None
        on_top = "([x, y]) => document.elementFromPoint(x, y).closest('.goshawk-one') !== null"
        assert page.evaluate(on_top, [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
    expect(page.get_by_role("button", name="Start", exact=True)).to_be_hidden()
    page.locator(".goshawk-one").click()
    assert g.link.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 30)


COUNT_INSTANCES = """window.mostInstances = window.draws = 0;
for (const name of ["drawElementsInstanced", "drawArraysInstanced"]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    window.mostInstances = Math.max(window.mostInstances, given.at(-1));
    window.draws++;
    return draw.apply(this, given);
  };
}"""


def opened_late(ground: Start, visit: Visit) -> Page:
    """A page that is opened while a flight is in progress."""
    g = ground()
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_READY, 10)
    assert g.link.start().accepted
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.plan is not None and s.remembered is not None, 10)
    page = visit(g.dashboard.url).page
    mode(page, "track")
    return page


def test_a_flight_without_a_graphics_card_has_few_pixels_and_instances_and_no_smoothed_edges(
    ground: Start, visit: Visit
) -> None:
    page = opened_late(ground, visit)
    page.evaluate(f"() => {{{COUNT_INSTANCES}}}")
    page.wait_for_function("window.draws > 10")
    # The software renderer draws each instance by itself: a line of viser's frustum, a letter of a label.
    assert page.evaluate("window.mostInstances") <= 40
    smooth = (
        "[...document.querySelectorAll('canvas')].map(c => c.getContext('webgl2')?.getContextAttributes().antialias)"
    )
    assert False in page.evaluate(smooth) and True not in page.evaluate(smooth)
    page.wait_for_function(
        "[...document.querySelectorAll('canvas')].some(c => c.width && c.width < 0.7 * c.clientWidth)"
    )


def test_a_page_opened_late_shows_the_flight_in_progress(ground: Start, visit: Visit, look: Any) -> None:
    page = opened_late(ground, visit)
    deadline = time.monotonic() + 60
    while look.flown_green(look.picture(page)) < 60:
        assert time.monotonic() < deadline, "the chosen trajectory was never seen"
