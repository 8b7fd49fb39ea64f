"""The review in a real browser, of real trials' logs: timeline, play, steps and jumps move the scene; charts zoom
together and take any signal; flights lie over each other; what is cut off opens."""

from __future__ import annotations

import json
import re
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import other_logs
import pytest
import recordings as rec
from goshawk_dashboards.charts.signals import Signals
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import marks_of
from goshawk_dashboards.review.dashboard import ReviewDashboard, ReviewView
from goshawk_dashboards.scene.remembered import surface
from goshawk_ground.pages.ports import free_port
from goshawk_ground.pages.replan import replanner_of
from goshawk_ground.pages.review import open_review
from playwright.sync_api import Page, expect
from stage import Seen

ROOT = Path(__file__).resolve().parents[2]
SIM = ROOT / "target/release/goshawk-sim"

SCENE_PX = 200
"""Of the page's picture, above the charts."""

Visit = Callable[[str], Seen]


@dataclass(frozen=True, kw_only=True)
class Box:
    """A part of the page, pixels."""

    x: float
    y: float
    width: float
    height: float


Review = Callable[..., ReviewDashboard]


def fly(folder: Path, *arguments: str) -> tuple[list[Path], dict[str, Any]]:
    """Flies trials; their logs in order, and the campaign's first cell."""
    report = folder / "report.json"
    command = [SIM, "fly", "--task", "track", "--log", folder, "--json", report, *arguments]
    subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    return sorted(folder.glob("*.mcap")), json.loads(report.read_text())["cells"][0]


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of a trial that was flown again alone."""
    logs, _ = fly(tmp_path_factory.mktemp("trial"), "--speed", "4", "--trials", "1", "--seed", "5", "--only", "0:0")
    return logs[0]


@pytest.fixture
def review() -> Iterator[Review]:
    """Starts reviews in this process, so that their scenes can be read."""
    started: list[ReviewDashboard] = []

    def start(*logs: Path, replay: Path | None = None, beside: Path | None = None) -> ReviewDashboard:
        replanner = replanner_of(ROOT / "target/release", sorted((ROOT / "air/models").glob("*.onnx")))
        port = free_port(18700)
        started.append(open_review(logs, replay, host="127.0.0.1", port=port, replanner=replanner, beside=beside))
        return started[-1]

    yield start
    for dashboard in started:
        dashboard.close()


@pytest.fixture
def plain(visit: Callable[..., Seen]) -> Visit:
    """Opens an address in a page that draws no scene, high enough for some charts."""
    return lambda url: visit(url, height=1100, scene=False)


def eventually(what: str, true: Callable[[], bool], limit_s: float = 60.0) -> None:
    """Waits for something that a busy machine takes its time for."""
    deadline = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < deadline, what
        time.sleep(0.05)


def first_view(r: ReviewDashboard) -> ReviewView:
    """What the only browser sees."""
    eventually("nobody is connected", lambda: len(r.views) == 1)
    return r.views[0]


def press(page: Page, name: str) -> None:
    """A click on a button."""
    page.get_by_role("button", name=name, exact=True).click()


def shown_s(page: Page) -> float:
    """The instant that the page shows."""
    return float(page.locator('[data-goshawk="cursor"]').get_attribute("data-time") or "nan")


def test_the_timeline_moves_scene_picture_candidates_and_plots(
    review: Review, visit: Visit, look: Any, trial: Path
) -> None:
    r = review(trial)
    flight = Flight.open(trial)
    seen = visit(r.url)
    page, view = seen.page, first_view(r)
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", re.compile("idle|ready|takeoff"))
    expect(page.locator('[data-goshawk="band"]')).to_have_attribute("data-phases", re.compile("take-off.*tracking"))

    number = page.get_by_label("Time, s")
    number.fill("9")
    number.press("Enter")
    eventually("the timeline did not move", lambda: view.shown_s == 9.0)
    plan, control = flight.plan_at(9.0), flight.control_at(9.0)
    assert plan is not None and control is not None
    expect(page.locator('[data-goshawk="cursor"]')).to_have_attribute("data-time", "9.000")
    expect(page.locator('[data-goshawk="candidates"]')).to_have_attribute("data-seq", str(plan.seq))
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    assert control.hover_thrust is not None
    expect(page.locator('[data-goshawk="learnt"]')).to_contain_text(f"{100 * control.hover_thrust:.1f} %")
    scene = view.scene.first
    assert np.allclose(scene.vehicle.position, control.pos_world_3, atol=1e-5)
    assert scene.candidates.count == 15
    assert np.allclose(scene.candidates.root.position, plan.start_pos_world_3, atol=1e-5)
    eventually("the chosen trajectory was never seen", lambda: look.flown_green(look.picture(page)[:SCENE_PX]) > 40)
    assert plan.chosen is not None
    flown = page.locator(f'[data-goshawk="parts"] tr[data-candidate="{plan.chosen}"]')
    expect(flown).to_contain_text(f"{plan.cost_N[plan.chosen]:.2f}")
    expect(flown).to_contain_text("flown")
    expect(page.locator('[data-goshawk="picture"] [data-candidate]')).to_have_count(15)
    north = page.locator('[data-line="0/measured acceleration north"] output')
    measured = flight.columns("control", ["acc_meas_world"])["acc_meas_world"][flight.index_at("control", 9.0) or 0, 1]
    expect(north).to_have_text(re.compile(r"\d m/s²"))

    def off() -> float:
        """Small numbers have more digits."""
        return abs(abs(float(north.inner_text().split()[0].replace("−", "-"))) - abs(measured))

    eventually("the readout is not the cursor's", lambda: off() < 0.01)
    remembered = flight.remembered_at(9.0)
    assert remembered is not None
    assert scene.remembered.faces.count == len(surface(remembered)[0])
    page.get_by_label("Remembered obstacles").dispatch_event("click")
    eventually("the toggle hid nothing", lambda: scene.remembered.faces.count == 0)
    assert seen.errors == []
    assert flight.world is not None, "a trial's log holds its forest"
    assert view.viewer.scene.get_handle_by_name("/first/world/trunks") is not None


def over(page: Page, chart: int) -> Box:
    """Where a chart's lines are, once all charts are there: they are as wide as each other."""
    page.wait_for_function("goshawkReview.charts.length > 5 && goshawkReview.charts.every(({ plot }) => plot)")
    box = page.locator('[data-goshawk="charts"] .u-over').nth(chart).bounding_box()
    assert box is not None
    return Box(**box)


def window_s(page: Page) -> tuple[float, float]:
    """What the charts show."""
    text = page.locator('[data-goshawk="charts"]').get_attribute("data-window") or "nan nan"
    from_s, to_s = (float(word) for word in text.split())
    return from_s, to_s


def scales_s(page: Page) -> list[list[float]]:
    """The same by each chart's own account."""
    return page.evaluate("goshawkReview.charts.map(({ plot }) => [plot.scales.x.min, plot.scales.x.max])")


def test_a_click_or_a_drag_on_phases_and_a_click_on_a_chart_seek(review: Review, plain: Visit, trial: Path) -> None:
    r = review(trial)
    flight = Flight.open(trial)
    page, view = plain(r.url).page, first_view(r)
    tracking = next(p for p in flight.phases if p.name == "tracking")
    middle_s = 0.5 * (tracking.start_s + tracking.end_s)

    def sought() -> bool:
        # The dock may still be finding its height, so that a click lands beside the phase: then click again.
        page.locator('[data-phase="tracking"]').first.click()
        deadline = time.monotonic() + 5
        while abs(view.player.time_s - middle_s) >= 0.2 and time.monotonic() < deadline:
            time.sleep(0.05)
        return abs(view.player.time_s - middle_s) < 0.2

    eventually("a click on a phase did not seek", sought)
    quarter_s = 0.25 * view.player.end_s

    def scrubbed() -> bool:
        # The dock may still be finding its height: the next drag begins where the band is then.
        band = page.locator('[data-goshawk="band"]').bounding_box()
        assert band is not None
        row = band["y"] + 0.5 * band["height"]
        page.mouse.move(band["x"] + 0.5 * band["width"], row)
        page.mouse.down()
        page.mouse.move(band["x"] + 0.25 * band["width"], row, steps=3)
        deadline = time.monotonic() + 5
        while abs(view.player.time_s - quarter_s) >= 0.2 and time.monotonic() < deadline:
            time.sleep(0.05)
        before_release_s = view.player.time_s
        page.mouse.up()
        return abs(before_release_s - quarter_s) < 0.2

    eventually("a drag did not scrub", scrubbed)
    chart = over(page, 0)
    page.mouse.click(chart.x + 0.75 * chart.width, chart.y + 0.5 * chart.height)
    later_s = 0.75 * view.player.end_s
    eventually("a click on a chart did not seek", lambda: abs(view.player.time_s - later_s) < 0.2)
    # A drag that begins with shift scrubs in the chart, and zooms nothing.
    page.keyboard.down("Shift")
    page.mouse.move(chart.x + 0.7 * chart.width, chart.y + 0.5 * chart.height)
    page.mouse.down()
    page.mouse.move(chart.x + 0.4 * chart.width, chart.y + 0.5 * chart.height, steps=3)
    eventually("a drag with shift did not scrub", lambda: abs(view.player.time_s - 0.4 * view.player.end_s) < 0.2)
    page.mouse.up()
    page.keyboard.up("Shift")
    page.wait_for_timeout(300)
    assert abs(view.player.time_s - 0.4 * view.player.end_s) < 0.2
    assert window_s(page) == (0.0, round(view.player.end_s, 3))


def test_a_drag_zooms_all_charts_and_a_double_click_shows_the_whole_flight(
    review: Review, plain: Visit, trial: Path
) -> None:
    r = review(trial)
    page, view = plain(r.url).page, first_view(r)
    duration_s = view.player.end_s
    chart = over(page, 1)
    page.mouse.move(chart.x + 0.25 * chart.width, chart.y + 20)
    page.mouse.down()
    page.mouse.move(chart.x + 0.5 * chart.width, chart.y + 30, steps=4)
    page.mouse.up()
    eventually("nothing was zoomed", lambda: window_s(page)[1] < 0.9 * duration_s)
    assert np.allclose(window_s(page), [0.25 * duration_s, 0.5 * duration_s], atol=0.01 * duration_s)
    assert len(scales_s(page)) > 5
    assert np.allclose(scales_s(page), [list(window_s(page))] * len(scales_s(page)), atol=1e-3)
    page.mouse.dblclick(chart.x + 0.5 * chart.width, chart.y + 30)
    eventually("the whole flight did not come back", lambda: window_s(page) == (0.0, round(duration_s, 3)))


def test_any_signal_is_found_by_its_words_and_shares_a_chart_by_an_axis_of_its_own(
    review: Review, plain: Visit, trial: Path
) -> None:
    r = review(trial)
    flight = Flight.open(trial)
    seen = plain(r.url)
    page, view = seen.page, first_view(r)
    over(page, 0)
    page.get_by_role("button", name="+ signal").click()
    # Not all of them fit: the list says so.
    shown, more = page.locator("#goshawk-picker li button"), page.locator("#goshawk-picker li").last
    expect(shown).to_have_count(200)
    expect(more).to_have_text(f"… and {len(Signals(flight).names) - 200} more, type to narrow")
    page.get_by_label("Add to").select_option("0")
    page.get_by_label("Search a signal").fill("candidates.3 cost")
    expect(page.locator("#goshawk-picker li")).to_have_count(1)
    page.get_by_label("Search a signal").press("Enter")
    view.player.seek(9.0)
    plan = flight.plan_at(9.0)
    assert plan is not None
    row = page.locator('[data-goshawk="charts"] section').nth(0).locator('[data-line="0/plan.candidates.3.cost"]')
    expect(row.locator("output")).to_have_text(re.compile(rf"^{plan.cost_N[3]:.2f}"))
    axes = "goshawkReview.charts[0].plot.axes.map((axis) => axis.scale)"
    assert page.evaluate(axes) == ["x", "y m/s", "y "]
    row.get_by_label("take away").click()
    expect(row).to_have_count(0)
    assert seen.errors == []


def test_three_logs_lie_over_each_other_by_a_moment_that_all_of_them_had(
    review: Review, plain: Visit, tmp_path: Path
) -> None:
    logs = [rec.write_flight(tmp_path / f"flown-{k}.mcap", 6.0 + k) for k in range(3)]
    r = review(*logs)
    page, view = plain(r.url).page, first_view(r)
    speeds = page.locator('[data-goshawk="charts"] section').nth(0).locator("[data-line]")
    expect(speeds).to_have_count(3)
    assert [row.inner_text().split()[0] for row in speeds.all()] == ["0", "1", "2"]
    assert len(view.scene.others) == 2
    page.get_by_label("Aligned by").select_option("landing")
    eventually("nothing was aligned", lambda: np.allclose(view.seat.by_s, [0.0, -1.0, -2.0]))
    view.player.seek(3.0)
    x = [4.0 * (3.0 + k) for k in range(3)]
    scenes = [view.scene.first, *(other.scene for other in view.scene.others)]
    eventually("a vehicle is elsewhere", lambda: np.allclose([s.vehicle.position[0] for s in scenes], x, atol=0.05))
    # The longest began 2 s before the first: the axis does, too.
    assert np.allclose(window_s(page), [-2.0, view.player.end_s], atol=0.01)
    number = page.get_by_label("Time, s")
    number.fill("-1.9")
    number.press("Enter")
    longest = view.scene.others[1].scene
    eventually("its first second is out of reach", lambda: abs(longest.vehicle.position[0] - 4.0 * 0.1) < 0.05)
    assert not view.scene.first.vehicle.visible
    expect(page.locator('[data-goshawk="cursor"]')).to_have_attribute("data-time", "-1.900")
    place = page.locator('[data-goshawk="cursor"]').evaluate("c => parseFloat(c.style.left)")
    assert place == pytest.approx(100 * 0.1 / (view.player.end_s + 2.0), abs=0.1)


@pytest.mark.parametrize("width", [390, 1100])
def test_the_seconds_below_the_band_have_room_for_their_words(
    review: Review, visit: Callable[..., Seen], tmp_path: Path, width: int
) -> None:
    log = rec.LogFile(tmp_path / "long.mcap")
    for seq, time_s in enumerate((0.0, 139.0)):
        log.write("control", rec.START_NS + round(time_s * 1e9), rec.control(time_s, seq, 140.0))
    log.close()
    r = review(tmp_path / "long.mcap")
    page = visit(r.url, width=width, height=844, scene=False).page
    ticks = page.locator(".band .tick")
    expect(ticks.first).to_be_visible()
    sides = "ticks => ticks.map(tick => tick.getBoundingClientRect()).map(({left, right}) => [left, right])"
    eventually("there are few ticks", lambda: len(ticks.evaluate_all(sides)) >= width / 130)
    found = ticks.evaluate_all(sides)
    assert all(right + 2 < left for (_, right), (left, _) in pairwise(found))


def test_play_steps_keys_and_jumps(review: Review, plain: Visit, trial: Path) -> None:
    r = review(trial)
    flight = Flight.open(trial)
    page, view = plain(r.url).page, first_view(r)
    expect(page.locator('[data-goshawk="cursor"]')).to_have_attribute("data-time", re.compile(r"^0\.0"))
    # Slow enough that a machine with much else to do does not reach the end before it is asked to pause.
    page.get_by_label("Speed", exact=True).select_option("0.1")
    press(page, "Play")
    eventually("it did not play", lambda: view.player.playing and view.player.time_s > 0.1)
    press(page, "Pause")
    eventually("it did not pause", lambda: not view.player.playing)
    paused_s = view.player.time_s
    assert paused_s < view.player.end_s
    eventually("the page did not follow", lambda: abs(shown_s(page) - paused_s) < 1e-3)

    frames_s = flight.times_s("rgbd")
    press(page, "frame ▶")
    eventually("no step ahead", lambda: view.player.time_s == frames_s[np.searchsorted(frames_s, paused_s + 1e-3)])
    after_s = view.player.time_s
    page.keyboard.press("ArrowRight")
    eventually("the arrow key did not step", lambda: view.player.time_s > after_s)
    page.keyboard.press("ArrowLeft")
    eventually("the arrow key did not step back", lambda: view.player.time_s == after_s)

    view.player.seek(1.0)
    press(page, "event ▶")
    following_s = min(m.time_s for m in marks_of(flight) if m.time_s > 1.0)
    eventually("no jump to the next event", lambda: abs(view.player.time_s - following_s) < 1e-6)
    page.get_by_label("Jump").click()
    page.get_by_role("option", name=re.compile("the target is confirmed")).click()
    confirmed_s = next(p.start_s for p in flight.phases if p.name == "tracking")
    eventually("no jump to the event chosen", lambda: abs(view.player.time_s - confirmed_s) < 0.02)


def test_a_trial_that_failed_is_flown_again_alone_and_opens(review: Review, plain: Visit, tmp_path: Path) -> None:
    # No policy bears such a storm.
    arguments = ("--speed", "14", "--spacing", "3", "--wind", "30", "--trials", "3", "--seed", "3", "--only", "0:2")
    (log,), cell = fly(tmp_path, *arguments)
    assert cell["successes"] == 0
    r = review(log)
    page, view = plain(r.url).page, first_view(r)
    marks = marks_of(Flight.open(log))
    expect(page.locator('[data-goshawk="marks"]')).to_contain_text(marks[0].text)
    view.player.seek(marks[-1].time_s)
    expect(page.locator('[data-goshawk="cursor"]')).to_have_attribute("data-time", f"{marks[-1].time_s:.3f}")
    collisions = Flight.open(log).columns("sim_truth", ["collisions"])["collisions"]
    assert collisions[-1] == cell["failures"]["collision"]


def test_a_log_that_was_cut_off_opens_and_says_so(review: Review, plain: Visit, trial: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = trial.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    r = review(cut)
    page, view = plain(r.url).page, first_view(r)
    assert view.player.end_s > 5.0
    view.player.seek(view.player.end_s)
    expect(page.locator('[data-goshawk="marks"]')).to_contain_text("the log was cut off here")


def test_two_flights_and_a_replay_share_the_scene(review: Review, plain: Visit, tmp_path: Path) -> None:
    first = rec.write_flight(tmp_path / "first.mcap")
    other = rec.write_flight(tmp_path / "other.mcap", 10.0, chosen=2)
    replay = rec.write_replay(tmp_path / "replay.mcap", 8.0, chosen=3)
    r = review(first, other, replay=replay)
    page, view = plain(r.url).page, first_view(r)
    assert view.player.end_s > 9.9
    view.player.seek(2.0)
    expect(page.locator('[data-goshawk="candidates"]')).to_contain_text("the other policy chose 4")
    (beside,) = view.scene.others
    assert beside.scene.chosen.node.visible
    assert view.scene.replayed.node.visible
    ends = view.scene.replayed.curve_S3[-1]
    plan = Flight.open(first).plan_at(2.0)
    assert plan is not None
    assert np.allclose(ends, plan.end_pos_world_N3[3], atol=1e-4)
    assert np.allclose(beside.scene.vehicle.position, view.scene.first.vehicle.position)


def test_each_browser_has_a_timeline_of_its_own(review: Review, plain: Visit, tmp_path: Path) -> None:
    r = review(rec.write_flight(tmp_path / "flight.mcap"))
    page = plain(r.url).page
    first_view(r)
    other = plain(r.url).page
    cursor, other_cursor = page.locator('[data-goshawk="cursor"]'), other.locator('[data-goshawk="cursor"]')
    expect(other_cursor).to_have_attribute("data-time", re.compile(r"^0\.0"))
    page.keyboard.press("ArrowRight")
    expect(cursor).not_to_have_attribute("data-time", re.compile(r"^0\.000"))
    page.keyboard.press("Space")
    eventually("it does not play", lambda: shown_s(page) > 0.5)
    expect(other_cursor).to_have_attribute("data-time", re.compile(r"^0\.0"))
    assert [view.player.playing for view in r.views][1:] == [False]


def test_a_replay_given_as_the_second_log_is_known_as_one(review: Review, plain: Visit, tmp_path: Path) -> None:
    first = rec.write_flight(tmp_path / "first.mcap")
    r = review(first, rec.write_replay(tmp_path / "replay.mcap", 8.0, chosen=3))
    plain(r.url)
    view = first_view(r)
    assert view.scene.others == ()
    view.player.seek(2.0)
    eventually("the other policy's choice was not drawn", lambda: view.scene.replayed.node.visible)


def alter(page: Page, key: str, value: str) -> None:
    """Asks for a parameter of another value."""
    page.get_by_label("Parameter", exact=True).fill(key)
    page.get_by_label("Value", exact=True).fill(value)
    page.get_by_role("button", name="Plan again", exact=True).click()


def test_an_altered_planner_is_shown_over_the_flight_in_words_scene_picture_and_charts(
    review: Review, plain: Visit, trial: Path
) -> None:
    r = review(trial)
    seen = plain(r.url)
    page, view = seen.page, first_view(r)
    over(page, 0)
    view.player.seek(9.01)
    press(page, "Plan again …")
    said = page.locator('[data-goshawk="altered"]:not(g)')
    alter(page, "planner.chase.standoff", "8")
    expect(said).to_have_text(re.compile("unknown field `standoff`"))
    assert view.seat.altered is None
    alter(page, "planner.chase.standoff_m", "8")
    expect(said).to_have_text(re.compile(r"^at \d+\.\d\d s it would have flown .*; otherwise in \d+ of \d+ plans"))
    altered = view.seat.altered
    assert altered is not None and altered.words == said.inner_text()
    flight = Flight.open(trial)
    flown, index = flight.plan_at(9.01), flight.index_at("plan", 9.01)
    assert flown is not None and index is not None
    # From the plan that was shown on.
    assert altered.at_s == pytest.approx(flight.time_s("plan", index), abs=1e-6)
    first = altered.replay.plan_for(flown)
    assert first is not None
    eventually("the candidates were not drawn", lambda: view.scene.altered.root.visible)
    assert view.scene.altered.count == 15
    expect(page.locator('[data-goshawk="picture"] g[data-goshawk="altered"] [data-candidate]')).to_have_count(15)
    assert first.chosen is not None
    expect(page.locator('[data-goshawk="candidates"]')).to_contain_text(f"the altered planner chose {first.chosen + 1}")
    chart = page.locator('[data-goshawk="charts"] section').nth(0)
    value = chart.locator('[data-line="0/altered: candidate flown"] output')
    expect(value).to_have_text(re.compile(rf"^{first.chosen + 1}\b"))
    view.player.seek(altered.at_s + 0.2)  # the controller answers after the plan
    expect(page.locator('[data-line="0/altered: thrust"] output')).to_have_text(re.compile(r"^\d"))
    assert window_s(page)[1] - window_s(page)[0] < 4.0
    press(page, "As it was flown")
    expect(page.locator('[data-line="0/altered: thrust"]')).to_have_count(0)
    eventually("the candidates stayed", lambda: not view.scene.altered.root.visible)
    assert seen.errors == []


def test_the_autopilots_own_log_lies_beside_under_the_same_cursor(review: Review, plain: Visit, tmp_path: Path) -> None:
    flown = other_logs.Flown(30.0, seed=3)
    log = other_logs.write_flown(tmp_path / "flight.mcap", flown)
    r = review(log, beside=other_logs.write_ulog(tmp_path / "flight.ulg", flown, 600.0, 100e-6))
    page, view = plain(r.url).page, first_view(r)
    over(page, 0)
    page.get_by_role("button", name="+ signal").click()
    page.get_by_label("Search a signal").fill("beside voltage")
    page.get_by_label("Search a signal").press("Enter")
    view.player.seek(12.3)
    row = page.locator('[data-line="0/beside: battery_status.voltage_v"]')
    expect(row.locator("output")).to_have_text(re.compile(r"^11\.3"))
    expect(page.locator('[data-line="0/beside: tilt"]')).to_have_count(1)
    lies = re.compile(r"^flight.ulg lies beside: its (600.00|599.99)")
    expect(page.locator('[data-goshawk="beside"]')).to_have_attribute("title", lies)
