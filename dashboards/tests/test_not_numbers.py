"""A log with values that are no numbers, or absurd ones: they hide nothing, and its report is written."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
import recordings as rec
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import marks_of
from goshawk_dashboards.report.report import make_report, write_page
from goshawk_dashboards.report.tracking import tracking
from goshawk_dashboards.report.why import why
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb

FROM_S, STEPS, EVERY_S = 1.5, 60, 0.02
Spoil = Callable[[pb.Control, pb.SimTruth, pb.Target], None]


def write(path: Path, spoil: Spoil, at: range = range(30, 31)) -> Flight:
    """A tracking flight of a second, some of whose steps are spoiled."""
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite"))
    for step in range(STEPS):
        time_s = FROM_S + EVERY_S * step
        control, truth, target = rec.control(time_s, step, 8.0), rec.truth(time_s), rec.target(time_s, step, True)
        if step in at:
            spoil(control, truth, target)
        for channel, message in (("control", control), ("sim_truth", truth), ("target", target)):
            log.write(channel, message.stamp_ns, message)
    log.close()
    return Flight.open(path)


@pytest.mark.parametrize("value", [math.nan, 1e308])
@pytest.mark.parametrize("whose", ["vehicle", "true target", "estimate"])
def test_a_place_that_is_none_does_not_end_the_report(tmp_path: Path, whose: str, value: float) -> None:
    def spoil(control: pb.Control, truth: pb.SimTruth, target: pb.Target) -> None:
        places = {"vehicle": control.pos_world, "true target": truth.target_pos_world, "estimate": target.pos_world}
        places[whose].y = value

    report = make_report(write(tmp_path / "flight.mcap", spoil))
    write_page(report, tmp_path / "flight.html")
    (path,) = [figure for figure in report.figures if figure.name == "path"]
    assert len(path.tables["path"]["time_s"]) == STEPS - (whose == "vehicle")
    assert len(path.tables["path_target"]["time_s"]) == STEPS - (whose == "estimate")
    if math.isnan(value):
        assert report.numbers.path_m == pytest.approx(4.1 * EVERY_S * STEPS, rel=0.1)
        assert report.numbers.target_lateral_m is not None
        # JSON knows no NaN.
        json.dumps([dataclasses.asdict(report.numbers), dataclasses.asdict(report.tracking)], allow_nan=False)


def test_the_least_clearance_is_found_beside_values_that_are_none(tmp_path: Path) -> None:
    def spoil(_control: pb.Control, truth: pb.SimTruth, _target: pb.Target) -> None:
        truth.clearance_m = truth.target_distance_m = math.nan

    flight = write(tmp_path / "flight.mcap", spoil, range(30, STEPS))
    least_m = 1.0 + 0.8 * math.cos(FROM_S + 29 * EVERY_S)
    assert f"closest to an obstacle: {least_m:.2f} m" in [mark.text for mark in marks_of(flight)]
    sentences = why(flight)
    assert any(sentence.endswith(f"{least_m:.2f} m.") for sentence in sentences)
    assert any(sentence.endswith("and 6.1 m at the end.") for sentence in sentences)


def test_no_clearance_at_all_is_told_of_as_none(tmp_path: Path) -> None:
    def spoil(_control: pb.Control, truth: pb.SimTruth, _target: pb.Target) -> None:
        truth.clearance_m = truth.target_distance_m = math.nan

    flight = write(tmp_path / "flight.mcap", spoil, range(STEPS))
    assert not [mark for mark in marks_of(flight) if "closest" in mark.text]
    assert not [sentence for sentence in why(flight) if "nearest" in sentence or "nan" in sentence]


def test_a_failed_check_of_the_odometry_is_told_beside_values_that_are_none(tmp_path: Path) -> None:
    def spoil(control: pb.Control, _truth: pb.SimTruth, _target: pb.Target) -> None:
        control.odometry_doubt = 1.5 if control.seq == 31 else math.nan

    flight = write(tmp_path / "flight.mcap", spoil, range(30, 32))
    failed_s = EVERY_S * 31
    assert f"The odometry failed a check at {failed_s:.2f} s." in why(flight)
    assert tracking(flight, None).odometry_doubt_most == 1.5


def test_an_odometry_of_which_nothing_is_known_has_no_greatest_doubt(tmp_path: Path) -> None:
    def spoil(control: pb.Control, _truth: pb.SimTruth, _target: pb.Target) -> None:
        control.odometry_doubt = math.nan

    assert tracking(write(tmp_path / "flight.mcap", spoil, range(STEPS)), None).odometry_doubt_most is None
