"""Any number of any channel over time, thinned to what a screen shows, and flights laid over each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.charts.curves import at, drawn
from goshawk_dashboards.charts.derived import angles_M3
from goshawk_dashboards.charts.signals import REPLAYED, Signals, unit_of
from goshawk_dashboards.log import align, numbers
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.review.desk import short_names
from goshawk_proto import goshawk_pb2 as pb


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of eight seconds."""
    return rec.write_flight(tmp_path_factory.mktemp("signals") / "flight.mcap")


@pytest.fixture(scope="module")
def flight(path: Path) -> Flight:
    """The same, opened."""
    return Flight.open(path)


def test_every_number_of_every_channel_can_be_read(flight: Flight) -> None:
    signals = Signals(flight)
    wanted = ["control.vel_world.x", "plan.candidates.7.cost", "target.covariance_upper.14"]
    wanted += ["control.mode", "plan.chosen"]
    assert set(wanted) <= set(signals.names)
    series = signals.read(wanted)
    assert [len(series[name][0]) for name in wanted] == [
        flight.count(name.split(".")[0]) for name in wanted
    ]  # fmt: skip
    assert set(series["control.vel_world.x"][1]) == {4.0}
    assert set(series["plan.chosen"][1]) == {7.0}
    assert set(series["plan.candidates.7.cost"][1]) == {1.0}


def test_a_signal_that_a_log_does_not_have_has_no_samples(flight: Flight) -> None:
    assert len(Signals(flight).read(["imu.ang_vel_body.x"])["imu.ang_vel_body.x"][0]) == 0


def test_an_item_of_a_list_is_found_by_its_name() -> None:
    health = pb.Health(rates=[pb.Rate(name="camera", hz=30.0), pb.Rate(name="planner", hz=28.5)])
    found = list(numbers.paths(pb.Health.DESCRIPTOR, [health]))
    assert "rates.planner.hz" in found
    assert numbers.getter("rates.planner.hz")(health) == 28.5
    assert np.isnan(numbers.getter("rates.odometry.hz")(health))
    assert np.isnan(numbers.getter("battery_fraction")(health))


def test_units_are_those_of_the_names() -> None:
    names = ("speed", "control.vel_world.x", "imu.ang_vel_body.z", "control.plan_age_s", "planner_input.speed_mps")
    assert [unit_of(name) for name in names] == ["m/s", "m/s", "rad/s", "s", "m/s"]
    assert unit_of("control.mode") == unit_of("plan.candidates.3.cost") == ""


def test_a_replay_has_a_cost_of_its_own(flight: Flight, tmp_path: Path) -> None:
    replay = Flight.open(rec.write_replay(tmp_path / "replay.mcap", 8.0, chosen=3))
    assert REPLAYED in Signals(flight, {REPLAYED: replay.chosen_cost}).names
    assert REPLAYED not in Signals(flight).names


def test_a_line_keeps_its_extremes_however_few_columns_there_are() -> None:
    times_s = np.linspace(0.0, 600.0, 120_000, endpoint=False)
    values = np.sin(times_s)
    values[77_777] = 9.0
    line_s, line = drawn(times_s, values, 0.0, 600.0, 300)
    assert len(line_s) <= 2 * 300 + 2
    assert np.all(np.diff(line_s) > 0.0)
    assert line.max() == 9.0
    assert line.min() == pytest.approx(-1.0, abs=1e-3)


def test_a_line_is_broken_where_samples_are_missing_and_reaches_the_edges_of_its_window() -> None:
    times_s = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(3.0, 4.0, 0.01)])
    line_s, line = drawn(times_s, np.ones(len(times_s)), 1.5, 3.5, 1000)
    assert np.count_nonzero(np.isnan(line)) == 1
    assert line_s[0] < 1.5 and line_s[-1] >= 3.5


def test_there_is_no_value_long_after_the_last_sample_nor_where_there_is_none() -> None:
    times_s, values = np.array([1.0, 1.1]), np.array([5.0, np.nan])
    assert at(times_s, values, 0.9) is None
    assert at(times_s, values, 1.05) == 5.0
    assert at(times_s, values, 1.15) is None
    assert at(times_s[:1], values[:1], 9.0) is None


def test_angles_are_those_of_the_rotation() -> None:
    half = np.radians(15.0)
    q_M4 = np.array([[np.cos(half), 0.0, 0.0, 0.0]] * 3)
    for axis in range(3):
        q_M4[axis, 1 + axis] = np.sin(half)
    np.testing.assert_allclose(np.degrees(angles_M3(q_M4)), 30.0 * np.eye(3), atol=1e-9)


def test_flights_are_aligned_by_what_all_of_them_had(flight: Flight, tmp_path: Path) -> None:
    other = Flight.open(rec.write_flight(tmp_path / "other.mcap", 6.0, told="the gust came"))
    by = align.common([flight, other])
    assert by[align.START] == (0.0, 0.0)
    assert by["landing"] == (0.0, pytest.approx(2.0))
    assert "the gust came" not in by


def test_names_are_told_apart_by_what_differs() -> None:
    assert short_names(["track-4mps-000", "track-4mps-001"]) == ["000", "001"]
    assert short_names(["track-3mps-000", "track-4mps-000"]) == ["3mps-000", "4mps-000"]
    assert short_names(["a", "a"]) == ["a", "a"]
    assert short_names(["alone-1"]) == ["alone-1"]
