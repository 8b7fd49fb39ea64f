"""The measured acceleration is the IMU's: without it there is a gap. A simulation draws the true one beside it."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.charts import curves
from goshawk_dashboards.charts.signals import Signals
from goshawk_dashboards.exports import Format, export_log
from goshawk_dashboards.instruments.panel import panel_html
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.canvas import Figure, svg
from goshawk_dashboards.report.over_time import over_time
from goshawk_dashboards.report.report import make_report
from goshawk_dashboards.state import decode
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]

LOST_S = 3.0
"""When the autopilot of the made-up flight stops sending its IMU."""


@pytest.fixture(scope="module")
def felt(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """A flight with an IMU until LOST_S."""
    path = tmp_path_factory.mktemp("felt") / "felt.mcap"
    return Flight.open(rec.write_flight(path, 6.0, imu_until_s=LOST_S))


@pytest.fixture(scope="module")
def unfelt(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """A flight without an IMU."""
    path = tmp_path_factory.mktemp("unfelt") / "unfelt.mcap"
    return Flight.open(rec.write_flight(path, 3.0, imu_until_s=0.0))


def test_what_is_not_measured_is_absent_and_zero_is_zero() -> None:
    unit = pb.Quat(w=1.0)
    assert decode.control(pb.Control(world_from_body=unit)).acc_meas_world_3 is None
    still = decode.control(pb.Control(world_from_body=unit, acc_meas_world=pb.Vec3()))
    np.testing.assert_array_equal(still.acc_meas_world_3, [0.0, 0.0, 0.0])
    assert decode.truth(pb.SimTruth()).acc_world_3 is None


def test_a_column_of_vectors_has_gaps_where_none_was_sent(felt: Flight) -> None:
    columns = felt.columns("control", ["acc_meas_world"])
    known = np.isfinite(columns["acc_meas_world"]).all(axis=1)
    np.testing.assert_array_equal(known, columns.times_s < LOST_S)


def drawn(snap: Snapshot) -> dict[str, float]:
    """What the instruments draw of a snapshot."""
    track = Track.of([snap])
    return {name: float(column[-1]) for name, column in track.window(1.0)[1].items()}


def test_the_instruments_have_a_gap_without_an_imu_and_say_so(snap: Make) -> None:
    base = snap()
    assert base.control is not None
    assert drawn(base)["measured north"] == 1.0
    assert "no IMU" not in panel_html(base, Track.of([base]))
    without = replace(base, control=replace(base.control, acc_meas_world_3=None))
    assert np.isnan(drawn(without)["measured north"])
    assert drawn(without)["desired north"] == 2.0
    assert "measured (no IMU)" in panel_html(without, Track.of([without]))


def test_the_instruments_draw_the_truth_of_a_simulation_alone(snap: Make) -> None:
    assert np.isnan(drawn(snap())["true north"])
    assert "true" not in panel_html(snap(), Track.of([snap()]))
    simulated = snap(truth=decode.truth(rec.truth(1.0)))
    assert drawn(simulated)["true north"] == pytest.approx(-2.0 * np.sin(1.0))
    assert "true" in panel_html(simulated, Track.of([simulated]))
    assert np.isnan(drawn(snap(age_s=5.0, truth=decode.truth(rec.truth(1.0))))["true north"])


def test_the_review_has_measured_and_true_and_a_gap_after_the_imu_was_lost(felt: Flight) -> None:
    signals = Signals(felt)
    signals.read(["measured acceleration north", "true acceleration north"])
    assert signals.at("measured acceleration north", 2.0) == pytest.approx(-2.0 * np.sin(2.0), abs=0.05)
    assert signals.at("measured acceleration north", 5.0) is None
    assert signals.at("true acceleration north", 5.0) == pytest.approx(-2.0 * np.sin(5.0), abs=0.1)


def test_the_review_of_a_flight_without_an_imu_has_no_measured_acceleration(unfelt: Flight) -> None:
    times_s, values = Signals(unfelt).read(["measured acceleration north"])["measured acceleration north"]
    assert len(curves.drawn(times_s, values, 0.0, 8.0, 300)[0]) == 0


def disturbance(flight: Flight) -> Figure:
    """The report's figure of the accelerations."""
    (figure,) = (f for f in make_report(flight).figures if f.name == "disturbance")
    return figure


def test_the_report_has_a_gap_after_the_imu_was_lost_and_the_truth(felt: Flight) -> None:
    figure = disturbance(felt)
    table = figure.tables["disturbance"]
    flown = (table["time_s"] > rec.TAKEOFF_S - 1e-6) & (table["time_s"] < LOST_S)
    np.testing.assert_array_equal(np.isfinite(table["measured_up_mps2"]), flown)
    true = figure.tables["disturbance_true"]
    assert set(true["true_up_mps2"][true["time_s"] > rec.TAKEOFF_S - 1e-6]) == {0.05}
    page = svg(figure)
    assert ">measured<" in page and ">true<" in page


def test_the_report_of_a_flight_without_an_imu_says_so(unfelt: Flight) -> None:
    figure = disturbance(unfelt)
    assert "no IMU" in figure.caption
    assert ">measured<" not in svg(figure)
    assert "There was no IMU" in over_time(unfelt, None, {})


def test_exports_leave_out_what_was_not_measured(felt: Flight, unfelt: Flight, tmp_path: Path) -> None:
    sent = round(LOST_S * rec.CONTROL_HZ)
    ros2 = export_log(felt, Format.ROS2, tmp_path / "felt.ros2.mcap").counts
    assert ros2["/acceleration/measured"] == sent < ros2["/acceleration/desired"]
    assert ros2["/acceleration/true"] == felt.count("sim_truth")
    assert "/acceleration/measured" not in export_log(unfelt, Format.ROS2, tmp_path / "unfelt.ros2.mcap").counts
    folder = export_log(felt, Format.CSV, tmp_path / "felt_csv").path
    with (folder / "tel_control.csv").open(newline="", encoding="utf-8") as file:
        cells = [row["acc_meas_world.y"] for row in csv.DictReader(file)]
    assert all(cells[:sent]) and not any(cells[sent:])
