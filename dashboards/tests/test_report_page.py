"""A report's page: what was held, with its limits, what came again and again, and the flight before."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report import parameters
from goshawk_dashboards.report.parameters import flight_before
from goshawk_dashboards.report.report import make_report, write_page
from goshawk_dashboards.report.tracking import tracking
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb

LIMITS = "[airframe]\nmin_thrust = 0.05\nmax_thrust = 0.9\n"
LEFT = (0.9, 0.7, 0.5, 0.4)
"""Charge of the battery, over the flight."""
OFF_M = (0.1, 0.3, 0.5, 1.0)
"""Of the target's estimate from its true place; it is believed to 0.2 m."""


def write(path: Path, vehicle_toml: str = LIMITS, steps: int = 40) -> Flight:
    """It turns left, faster and faster, and hovers on half its thrust."""
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite", vehicle_toml=vehicle_toml))
    for k in range(steps):
        stamp_ns, part, turned_rad = rec.START_NS + k * 50_000_000, k * 4 // steps, 0.001 * k * k
        turned = pb.Quat(w=np.cos(turned_rad / 2), z=np.sin(turned_rad / 2))
        log.write("control", stamp_ns, pb.Control(
            seq=k, stamp_ns=stamp_ns, mode=pb.MODE_TRACK, pos_world=pb.Vec3(z=2.0), thrust_n=8.0, thrust_norm=0.5,
            hover_thrust=0.5, world_from_body=turned, world_from_body_des=turned,
        ))  # fmt: skip
        log.write("imu", stamp_ns, pb.Imu(stamp_ns=stamp_ns, ang_vel_body=pb.Vec3(z=0.04 * k)))
        log.write("controller_input", stamp_ns, pb.ControllerInput(seq=k, stamp_ns=stamp_ns, battery=LEFT[part]))
        log.write("sim_truth", stamp_ns, pb.SimTruth(
            stamp_ns=stamp_ns, pos_world=pb.Vec3(z=2.0), target_pos_world=pb.Vec3(x=6.0, z=1.0)
        ))  # fmt: skip
        log.write("target", stamp_ns, pb.Target(
            seq=k, stamp_ns=stamp_ns, pos_world=pb.Vec3(x=6.0 + OFF_M[part], z=1.0), vel_world=pb.Vec3(),
            confirmed=True, covariance_upper=np.diag([0.04] * 6)[np.triu_indices(6)].tolist(),
        ))  # fmt: skip
        if k % 2:
            text = ("Track → Search: the target has not been seen for too long",
                    "Search → Track: the target is confirmed")[k // 2 % 2]  # fmt: skip
            log.write("event", stamp_ns, pb.Event(stamp_ns=stamp_ns, kind="mode", text=text))
    log.close()
    return Flight.open(path)


def page_of(flight: Flight) -> str:
    """Its page."""
    page = flight.path.with_suffix(".html")
    write_page(make_report(flight), page)
    return page.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """A made-up flight."""
    return write(tmp_path_factory.mktemp("log") / "flight.mcap")


@pytest.fixture(scope="module")
def page(flight: Flight) -> str:
    """Its page."""
    return page_of(flight)


def charts(page: str) -> dict[str, dict[str, list[float]]]:
    """Title of each chart, and its lines' values."""
    (text,) = re.findall(r'<script type="application/json" id="flown">(.*?)</script>', page, re.DOTALL)
    return {c["title"]: {line["label"]: line["v"] for line in c["lines"]} for c in json.loads(text)["charts"]}


def test_the_battery_is_told_from_the_first_to_the_last_report_of_it(flight: Flight, page: str) -> None:
    held = tracking(flight, None)
    assert (held.battery_start_fraction, held.battery_end_fraction) == (0.9, 0.4)
    assert "<b>90 → 40 <small>%</small></b><span>battery</span>" in page
    assert charts(page)["Battery"]["battery"][0] == 90.0


def test_the_target_is_within_two_deviations_as_often_as_its_error_is(flight: Flight, page: str) -> None:
    # 0.1 m and 0.3 m are within 2 × 0.2 m, 0.5 m and 1 m are not.
    assert tracking(flight, None).target_within_2_sigma_fraction == 0.5
    assert "<b>50 <small>%</small></b><span>target within 2 σ</span>" in page
    filtered = charts(page)["Target filter's consistency"]
    assert set(filtered["σ of the target's place"]) == {0.2}
    assert sorted(set(filtered["error of the target's place"])) == [0.1, 0.3, 0.5, 1.0]


def test_the_turning_that_was_asked_for_is_drawn_beside_the_one_that_was_flown(page: str) -> None:
    rates = charts(page)["Yaw rate"]
    assert rates["yaw rate"][20] == pytest.approx(np.degrees(0.8), rel=0.01)
    assert max(rates["yaw rate asked"]) == pytest.approx(np.degrees(0.04 * 39), rel=0.05)


def test_the_limits_of_the_thrust_are_lines_where_the_vehicle_file_tells_them(page: str, tmp_path: Path) -> None:
    thrust = charts(page)["Thrust"]
    assert (set(thrust["least thrust"]), set(thrust["most thrust"])) == ({5.0}, {90.0})
    untold = charts(page_of(write(tmp_path / "x.mcap", vehicle_toml="name = 'kite'", steps=4)))["Thrust"]
    assert set(untold) == {"thrust", "hover thrust"}


def test_modes_that_flap_are_two_lines_of_the_reports_events(page: str) -> None:
    events = page[page.index("<h2>Events</h2>") :]
    rows = re.findall(r"<tr><td class='number'>([\d.]+)</td>.*?<td>([^<]*)<b>([^<]*)</b></td></tr>", events)
    assert rows == [
        ("1.85", "Track → Search: the target has not been seen for too long ", "× 10"),
        ("1.95", "Search → Track: the target is confirmed ", "× 10"),
    ]


def demo(folder: Path, name: str, wall_time: str, vehicle: str = "kite", **facts: Any) -> Flight:
    """A log in a folder of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    log = rec.LogFile(folder / name)
    header = pb.LogHeader(protocol=PROTOCOL, vehicle=vehicle, wall_time=wall_time, **facts)
    log.write("header", rec.START_NS, header)
    log.write("control", rec.START_NS, pb.Control())
    log.close()
    return Flight.open(folder / name)


def before(flight: Flight) -> str | None:
    """The name of the flight before."""
    earlier = flight_before(flight)
    return earlier and earlier.name


def test_the_flight_before_a_demos_lies_in_another_folder_and_is_found_by_its_date(tmp_path: Path) -> None:
    demo(tmp_path / "c", "1.mcap", "2026-05-01T10:00:00Z")
    demo(tmp_path / "a", "9.mcap", "2026-05-01T11:00:00Z")
    demo(tmp_path / "b", "2.mcap", "2026-05-01T11:30:00Z", vehicle="crow")
    now = demo(tmp_path / "d", "5.mcap", "2026-05-01T12:00:00.000Z")
    demo(tmp_path / "e", "0.mcap", "2026-05-01T13:00:00Z")
    assert before(now) == "a/9.mcap"
    demo(tmp_path / "d", "4.mcap", "2026-04-01T12:00:00Z")
    assert before(now) == "4.mcap", "what lies beside it goes before"


def test_a_log_by_its_name_alone_is_compared_with_those_of_other_folders_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    demo(tmp_path / "a", "1.mcap", "2026-05-01T10:00:00Z")
    demo(tmp_path / "b", "2.mcap", "2026-05-01T11:00:00Z")
    monkeypatch.chdir(tmp_path / "b")
    assert before(Flight.open(Path("2.mcap"))) == "a/1.mcap"


def test_a_flight_without_a_date_has_none_before_it_in_another_folder(tmp_path: Path) -> None:
    demo(tmp_path / "a", "1.mcap", "")
    demo(tmp_path / "b", "1.mcap", "yesterday")
    assert before(demo(tmp_path / "c", "2.mcap", "")) is None
    assert before(demo(tmp_path / "d", "2.mcap", "2026-05-01T12:00:00Z")) is None


def test_of_many_folders_those_of_about_the_same_time_are_looked_into(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parameters, "MOST_FOLDERS", 2)
    for k in range(4):
        demo(tmp_path / f"{k}", "1.mcap", f"2026-05-01T1{k}:00:00Z")
        os.utime(tmp_path / f"{k}", (1e9 + k, 1e9 + k))
    now = demo(tmp_path / "now", "1.mcap", "2026-05-01T20:00:00Z")
    os.utime(now.path, (1e9 + 1.4, 1e9 + 1.4))
    assert before(now) == "2/1.mcap"
