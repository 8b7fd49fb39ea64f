"""A flight's report: its numbers, its page, its figures, from a made-up flight whose every number is known."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.charts.clearance import seen_clearance
from goshawk_dashboards.charts.errors import target_errors
from goshawk_dashboards.exports import frames
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.canvas import write
from goshawk_dashboards.report.latency import latencies
from goshawk_dashboards.report.parameters import Change, changes, flight_before
from goshawk_dashboards.report.report import Report, make_report, write_page
from goshawk_dashboards.report.season.row import row_of
from goshawk_dashboards.report.summary import card
from goshawk_dashboards.report.tracking import spectrum_of, tracking
from goshawk_dashboards.report.why import why
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from PIL import Image

DURATION_S = 8.0
VEHICLE_TOML = "[camera]\nposition_m = [0.1, 0.0, 0.0]\ntilt_deg = 0.0\n"


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up flight."""
    return rec.write_flight(tmp_path_factory.mktemp("log") / "flight.mcap", DURATION_S, vibrates=True)


@pytest.fixture(scope="module")
def report(path: Path) -> Report:
    """Its report."""
    return make_report(Flight.open(path))


@pytest.fixture(scope="module")
def page(report: Report, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Its page."""
    file = tmp_path_factory.mktemp("page") / "flight.html"
    write_page(report, file)
    return file.read_text(encoding="utf-8")


def write_log(
    path: Path, *messages: tuple[str, pb.Control | pb.SimTruth | pb.Event | pb.Health | pb.LogHeader]
) -> Flight:
    """A log of a few messages, 10 ms apart."""
    log = rec.LogFile(path)
    for k, (channel, message) in enumerate(messages):
        log.write(channel, rec.START_NS + k * 10_000_000, message)
    log.close()
    return Flight.open(path)


def test_the_card_tells_what_kind_of_flight_it_was(report: Report) -> None:
    assert (report.card.vehicle, report.card.profile) == ("kite", "chase")
    assert report.card.wall_time == "2026-01-01T00:00:00.000Z"
    assert report.card.duration_s == pytest.approx(DURATION_S, abs=0.01)
    assert report.card.phases_s["take-off"] == pytest.approx(rec.TAKEOFF_S)
    assert report.card.phases_s["search"] == pytest.approx(rec.FOUND_S - rec.SEARCH_S)
    assert report.card.faults == ("fallback: plan expired brake",)


@pytest.mark.parametrize(
    ("modes", "outcome"),
    [
        ([pb.MODE_TAKEOFF, pb.MODE_TRACK, pb.MODE_STOPPING, pb.MODE_LANDED], "landed"),
        ([pb.MODE_TAKEOFF, pb.MODE_TRACK, pb.MODE_FAULT], "handed back"),
        ([pb.MODE_TAKEOFF, pb.MODE_STOPPING], "ended: landing"),
        ([pb.MODE_READY, pb.MODE_IDLE], "never flew"),
    ],
)
def test_the_outcome_is_how_the_log_ends(modes: list[pb.Mode], outcome: str, tmp_path: Path) -> None:
    steps = [("control", pb.Control(seq=k, mode=mode)) for k, mode in enumerate(modes)]
    assert card(write_log(tmp_path / "x.mcap", *steps)).outcome == outcome


def test_a_collision_during_the_log_is_its_outcome(tmp_path: Path) -> None:
    steps = [("sim_truth", pb.SimTruth(collisions=n, clearance_m=1.0)) for n in (2, 3)]
    flight = write_log(tmp_path / "x.mcap", steps[0], ("control", pb.Control(mode=pb.MODE_LANDED)), steps[1])
    assert card(flight).outcome == "collided"


def test_a_campaigns_verdict_is_the_outcome(tmp_path: Path) -> None:
    verdict = pb.Event(severity=pb.SEVERITY_ERROR, kind="trial", text="collision (ground)")
    flight = write_log(tmp_path / "x.mcap", ("control", pb.Control(mode=pb.MODE_TRACK)), ("event", verdict))
    assert card(flight).outcome == "collision (ground)"


def test_a_log_that_was_cut_off_says_so(path: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-2000])
    assert card(Flight.open(cut)).outcome == "cut off"


def test_faults_are_counted_and_those_that_last_are_counted_once(tmp_path: Path) -> None:
    late = pb.Event(severity=pb.SEVERITY_WARNING, kind="camera", text="camera late")
    flight = write_log(
        tmp_path / "x.mcap",
        ("event", late),
        ("event", late),
        ("event", pb.Event(severity=pb.SEVERITY_INFO, kind="mode", text="fine")),
        ("health", pb.Health(faults=["odometry stale"])),
        ("health", pb.Health(faults=["odometry stale"])),
        ("health", pb.Health()),
    )
    assert card(flight).faults == ("camera late (2 times)", "odometry stale")


def test_the_numbers_are_those_of_the_motion(report: Report) -> None:
    numbers = report.numbers
    expected_m = sum(np.hypot(4.0, 2.0 * np.cos(t)) * 0.001 for t in np.arange(0.0, DURATION_S, 0.001))
    assert numbers.path_m == pytest.approx(expected_m, rel=0.02)
    assert numbers.max_speed_mps == pytest.approx(np.hypot(4.0, 2.0), abs=0.01)
    assert numbers.mean_disturbance_mps2 == pytest.approx(0.1)
    # Tracked from 1 to 7 s, of which it is lost from 3.5 s on and searched for from 4 to 5 s.
    assert numbers.in_sight_fraction == pytest.approx(4.5 / 6.0, abs=0.03)
    assert (numbers.collisions, numbers.controller_hz) == (0, pytest.approx(rec.CONTROL_HZ))


def test_the_targets_error_is_along_and_across_the_line_of_sight(report: Report, path: Path) -> None:
    errors = target_errors(Flight.open(path))
    assert errors is not None
    # The truth is 6.1 m east of the vehicle, the estimate 6.0 m.
    assert np.allclose(errors.longitudinal_m_M, -0.1, atol=0.01)
    assert np.allclose(errors.lateral_m_M, 0.0, atol=0.01)


def test_latencies_are_those_of_the_stamps(path: Path) -> None:
    found = latencies(Flight.open(path))
    assert np.allclose(found.control_period_ms, 5.0)
    assert np.allclose(found.frame_to_plan_ms, 0.0)
    assert len(found.plan_age_ms) == 0


def test_the_camera_sits_where_the_vehicle_file_says() -> None:
    mount = frames.camera_mount(pb.LogHeader(vehicle_toml="[camera]\nposition_m = [0.1, 0, 0]\ntilt_deg = 10.0"))
    assert mount is not None
    forward_3 = frames.matrix(mount.body_from_camera_4) @ (1.0, 0.0, 0.0)
    assert forward_3 == pytest.approx((np.cos(np.radians(10.0)), 0.0, np.sin(np.radians(10.0))))
    assert frames.camera_mount(pb.LogHeader(vehicle_toml="name = 'kite'")) is None
    assert frames.camera_mount(pb.LogHeader(vehicle_toml="no TOML [")) is None


def wall_flight(
    path: Path, target: pb.Target | None = None, late_s: float = 0.0, steps: int = 20, pictures: int = 1000,
    ahead_m: Callable[[int], float] = lambda k: 0.0, mode: Callable[[int], pb.Mode] = lambda k: pb.MODE_TRACK,
) -> Flight:  # fmt: skip
    """The vehicle rises to 2 m and hovers 3.1 m before a wall, 3 m before its lens. Its last step is so late. It may
    go ahead, and so many pictures are taken."""
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle_toml=VEHICLE_TOML))
    picture, depth = rec.frame(0.0, 0, np.random.default_rng(1)), io.BytesIO()
    Image.fromarray(np.full((rec.HEIGHT, rec.WIDTH), 3000, dtype=np.uint16)).save(depth, "PNG")
    picture.depth_png = depth.getvalue()
    for k in range(steps):
        stamp_ns = rec.START_NS + k * 50_000_000 + (round(late_s * 1e9) if k == steps - 1 else 0)
        height_m = 0.1 if k < 2 else 2.0
        control = pb.Control(seq=k, stamp_ns=stamp_ns, mode=mode(k))
        control.pos_world.x, control.pos_world.z, control.world_from_body.w = ahead_m(k), height_m, 1.0
        log.write("control", stamp_ns, control)
        if k < pictures:
            log.write("rgbd", stamp_ns, picture)
        if target is not None:
            log.write("target", stamp_ns, target)
    log.close()
    return Flight.open(path)


def test_clearance_is_to_the_nearest_surface_that_depth_shows(tmp_path: Path) -> None:
    heard: list[tuple[str, int, int]] = []

    def hear(what: str, done: int, total: int) -> None:
        heard.append((what, done, total))

    seen = seen_clearance(wall_flight(tmp_path / "wall.mcap"), hear)
    assert seen is not None
    count = len(seen.times_s_M)
    assert heard == [("clearance by depth", k + 1, count) for k in range(count)], (
        "who waits does not hear how far it is"
    )
    assert np.nanmin(seen.nearest_m_M) == pytest.approx(3.1, abs=0.02)
    assert np.isnan(seen.nearest_m_M[0])


def test_the_time_until_a_record_that_comes_a_day_late_is_not_looked_through(tmp_path: Path) -> None:
    seen = seen_clearance(wall_flight(tmp_path / "wall.mcap", late_s=86_400.0))
    usual = seen_clearance(wall_flight(tmp_path / "usual.mcap"))
    assert seen is not None and usual is not None
    assert len(seen.times_s_M) <= len(usual.times_s_M) + 1
    assert seen.times_s_M[-1] == pytest.approx(86_400.95)


def test_a_camera_that_stopped_shows_what_it_saw_where_it_was_and_for_three_seconds(tmp_path: Path) -> None:
    flight = wall_flight(tmp_path / "dark.mcap", steps=120, pictures=4, ahead_m=lambda k: 0.05 * max(k - 3, 0))
    seen = seen_clearance(flight)
    assert seen is not None
    assert np.isnan(seen.nearest_m_M[seen.times_s_M > 0.15 + 3.1]).all()
    a_second_on = seen.nearest_m_M[(seen.times_s_M > 1.1) & (seen.times_s_M < 1.3)]
    assert a_second_on == pytest.approx(2.1, abs=0.15)


def test_a_seasons_clearance_by_depth_is_of_the_time_on_the_task(tmp_path: Path) -> None:
    flight = wall_flight(
        tmp_path / "landing.mcap", steps=40, ahead_m=lambda k: 0.0 if k < 20 else 1.0,
        mode=lambda k: pb.MODE_TRACK if k < 20 else pb.MODE_STOPPING,
    )  # fmt: skip
    seen, row = seen_clearance(flight), row_of(flight.path)
    assert seen is not None and seen.least_m == pytest.approx(2.1, abs=0.1)
    assert row is not None and (row.clearance_m, row.clearance_by) == (pytest.approx(3.1, abs=0.05), "depth")


def test_the_target_is_no_obstacle(tmp_path: Path) -> None:
    flight = wall_flight(tmp_path / "wall.mcap", pb.Target(pos_world=pb.Vec3(x=3.1), confirmed=True))
    seen, without = seen_clearance(flight), seen_clearance(wall_flight(tmp_path / "bare.mcap"))
    assert seen is not None and without is not None
    assert np.nanmin(seen.nearest_m_M) > np.nanmin(without.nearest_m_M) + 0.05


def test_without_depth_or_a_camera_there_is_no_clearance(path: Path, tmp_path: Path) -> None:
    assert seen_clearance(Flight.open(path)) is None
    assert seen_clearance(write_log(tmp_path / "x.mcap", ("control", pb.Control()))) is None


class Links(HTMLParser):
    """Everything that a page would fetch, and every id and the references to them."""

    def __init__(self) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.ids: list[str] = []
        self.tags: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        for name, value in attrs:
            if name in ("src", "href") and not (value or "").startswith(("#", "data:")):
                self.fetched.append(value or "")
            if name == "id":
                self.ids.append(value or "")


def test_the_page_needs_no_network(page: str) -> None:
    links = Links()
    links.feed(page)
    assert links.fetched == []
    assert not links.tags & {"link", "iframe"}
    assert "@import" not in page and not re.search(r"url\((?!#|data:)", page)


def test_the_page_has_its_courses_as_charts_and_the_other_figures_drawn(page: str, report: Report) -> None:
    links = Links()
    links.feed(page)
    names = [figure.name for figure in report.figures]
    assert names == ["path", "velocity", "disturbance", "clearance", "target_error", "vibration", "latency"]
    assert page.count("<figure class='panel'>") == len(names) - 3
    assert len(links.ids) == len(set(links.ids))
    assert set(re.findall(r"(?:url\(#|href=\"#)([^)\"]+)", page)) <= set(links.ids)
    flown = data_of(page)
    titles = [chart["title"] for chart in flown["charts"]]
    assert titles[:3] == ["Speed", "Velocity", "Target"]
    assert "Battery" not in titles, "what was not logged is left out"
    speed = flown["charts"][0]["lines"][0]
    assert max(speed["v"]) == pytest.approx(np.hypot(4.0, 2.0), abs=0.01)
    assert [band["from_s"] for band in flown["bands"]] == [phase.start_s for phase in report.flight.phases]


def data_of(page: str) -> dict[str, Any]:
    """What the page's charts draw."""
    (text,) = re.findall(r'<script type="application/json" id="flown">(.*?)</script>', page, re.DOTALL)
    return json.loads(text)


def test_the_page_follows_the_readers_theme(page: str) -> None:
    assert "prefers-color-scheme: dark" in page
    svg = page[page.index("<svg ") :]
    assert "var(--ink)" in svg and "var(--target)" in svg
    assert not re.search(r"#0102[0-9a-f]{2}", svg)


def test_words_of_a_log_cannot_break_the_page(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    flight = write_log(
        tmp_path / "x.mcap",
        ("header", pb.LogHeader(protocol=PROTOCOL, vehicle=evil, vehicle_toml=evil, profile=evil)),
        ("event", pb.Event(severity=pb.SEVERITY_ERROR, kind=evil, text=evil)),
    )
    write_page(make_report(flight), tmp_path / "x.html")
    text = (tmp_path / "x.html").read_text(encoding="utf-8")
    assert evil not in text
    assert text.count("&lt;script&gt;") >= 5


def test_the_same_log_makes_the_same_page(report: Report, page: str, path: Path, tmp_path: Path) -> None:
    write_page(make_report(Flight.open(path)), tmp_path / "again.html")
    assert (tmp_path / "again.html").read_text(encoding="utf-8") == page


def test_figures_are_pictures_and_tables(report: Report, tmp_path: Path) -> None:
    written = write(report.figures, tmp_path / "new" / "figures")
    names = {file.name for file in written}
    assert {f"{figure.name}.png" for figure in report.figures} <= names
    assert Image.open(tmp_path / "new/figures/disturbance.png").size[0] == 1500
    with (tmp_path / "new/figures/disturbance.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == round(DURATION_S * rec.CONTROL_HZ)
    flown = [row for row in rows if float(row["time_s"]) > rec.TAKEOFF_S - 1e-6]
    assert len(flown) == round((DURATION_S - rec.TAKEOFF_S) * rec.CONTROL_HZ)
    assert {float(row["disturbance_up_mps2"]) for row in flown} == {0.1}


def test_a_report_is_json(report: Report) -> None:
    facts = json.loads(json.dumps(dataclasses.asdict(report.numbers)))
    assert facts["target_longitudinal_m"]["p50"] == pytest.approx(-0.1, abs=0.01)


def test_a_vibration_stands_at_its_frequency_with_its_strength(path: Path) -> None:
    found = spectrum_of(Flight.open(path))
    assert found is not None
    assert found.hz_F[int(np.argmax(found.force_mps2_F3[:, 0]))] == pytest.approx(rec.VIBRATES_HZ)
    assert found.force_mps2_F3[:, 1].max() == pytest.approx(0.0, abs=1e-9)
    shaken = tracking(Flight.open(path), found).vibration_rms_mps2
    assert shaken == pytest.approx(rec.VIBRATES_MPS2 / np.sqrt(2.0), rel=0.05)


def test_without_an_imu_there_is_no_spectrum(tmp_path: Path) -> None:
    assert spectrum_of(Flight.open(rec.write_flight(tmp_path / "x.mcap", 4.0))) is None


def test_what_was_held_is_told_in_numbers(tmp_path: Path) -> None:
    half = np.radians(5.0)
    limits = "[airframe]\nmin_thrust = 0.05\nmax_thrust = 0.95\n"
    turned, level = pb.Quat(w=np.cos(half), x=np.sin(half)), pb.Quat(w=1.0)
    steps = [
        ("control", pb.Control(thrust_n=8.0, thrust_norm=thrust, world_from_body=turned, world_from_body_des=level))
        for thrust in (0.3, 0.95, 0.05, 0.4)
    ]
    header = ("header", pb.LogHeader(vehicle_toml=limits, protocol=PROTOCOL))
    held = tracking(write_log(tmp_path / "x.mcap", header, *steps), None)
    assert held.attitude_rms_deg == pytest.approx(10.0)
    assert held.thrust_at_limit_fraction == 0.5
    assert held.battery_start_fraction is None and held.target_within_2_sigma_fraction is None


def test_the_report_says_why_a_flight_ended_in_a_collision(tmp_path: Path) -> None:
    flight = Flight.open(rec.write_flight(tmp_path / "x.mcap", told="Takeoff → Track: it is seen", collides_s=5.0))
    sentences = why(flight)
    assert sentences[0] == "Its last change of mode came at 1.00 s. Takeoff → Track: it is seen."
    assert any(s.startswith("It touched something at 5.00 s, flying 4.0 m/s.") for s in sentences)
    assert "The planner then flew candidate 8, of 15 that it held to be free." in sentences
    # Lost from half a second after it was last seen, then searched for.
    assert any(s.startswith("The target was out of sight once, 1.5 s in all") for s in sentences)
    assert "The target was in the camera's view 100 % of that time." in sentences
    assert "The target was 6.1 to 6.1 m away, farthest at 1.00 s, and 6.1 m at the end." in sentences


def test_a_log_that_was_cut_off_says_that_the_rest_is_unknown(path: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(path.read_bytes()[:-2000])
    assert any("cut off" in sentence for sentence in why(Flight.open(cut)))


def test_parameters_that_changed_since_the_flight_before_are_listed(tmp_path: Path) -> None:
    def log(name: str, vehicle: str, tuning: str) -> Path:
        header = pb.LogHeader(protocol=PROTOCOL, vehicle=vehicle, tuning_toml=tuning, vehicle_toml="a = [1]")
        write_log(tmp_path / name, ("header", header), ("control", pb.Control()))
        return tmp_path / name

    log("1.mcap", "kite", "[observer]\ngain = 2.0\nlag = 1\n[[mode]]\nname = 'x'\ny = 1")
    log("2.mcap", "crow", "")
    (tmp_path / "3.mcap").write_text("no log")
    path = log("4.mcap", "kite", "[observer]\ngain = 3.0\nnew = 7\n[[mode]]\nname = 'x'\ny = 2")
    before = flight_before(Flight.open(path))
    assert before is not None and before.name == "1.mcap"
    assert changes(before.header, Flight.open(path).header) == [
        Change(name="tuning: mode.x.y", before="1", now="2"),
        Change(name="tuning: observer.gain", before="2.0", now="3.0"),
        Change(name="tuning: observer.lag", before="1", now="–"),
        Change(name="tuning: observer.new", before="–", now="7"),
    ]
    assert flight_before(Flight.open(tmp_path / "1.mcap")) is None
    page = tmp_path / "x.html"
    write_page(make_report(Flight.open(path), before), page)
    assert "Parameters since 1.mcap" in page.read_text(encoding="utf-8")


def test_a_recovered_log_is_not_the_flight_before_itself(tmp_path: Path) -> None:
    def log(name: str, **facts: Any) -> Flight:
        header = pb.LogHeader(protocol=PROTOCOL, vehicle="kite", **facts)
        write_log(tmp_path / name, ("header", header), ("control", pb.Control()))
        return Flight.open(tmp_path / name)

    def before(flight: Flight) -> str | None:
        earlier = flight_before(flight)
        return earlier and earlier.name

    log("1.mcap")
    log("2.mcap")
    assert before(log("2.recovered.mcap")) == "1.mcap"
    log("3.mcap", wall_time="2026-05-01T10:00:00Z", stamp_ns=5)
    assert before(log("4-clean.mcap", wall_time="2026-05-01T10:00:00Z", stamp_ns=5)) == "2.recovered.mcap"
    assert before(log("5.mcap", wall_time="2026-05-01T10:09:00Z", stamp_ns=5)) == "4-clean.mcap"
