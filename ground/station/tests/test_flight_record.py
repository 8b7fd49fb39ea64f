"""The verdict on a flight, and its figures."""

from __future__ import annotations

import numpy as np
import pytest
from goshawk_dashboards.state.views import BoxesView, TruthView
from goshawk_ground.demo.flight_record import FlightRecord, Summary
from goshawk_proto import goshawk_pb2 as pb

ZERO_3 = np.zeros(3)


def truth(
    time_s: float,
    *,
    path_m: float = 0.0,
    distance_m: float = 5.0,
    visible: bool = True,
    clearance_m: float = 1.0,
    collisions: int = 0,
    arrived: bool = False,
    x_m: float = 0.0,
    speed_mps: float = 3.0,
    goal_world_3: np.ndarray | None = None,
) -> TruthView:
    return TruthView(
        stamp_ns=int(time_s * 1e9),
        pos_world_3=np.array([x_m, 0.0, 1.5]),
        vel_world_3=np.array([speed_mps, 0.0, 0.0]),
        acc_world_3=None,
        target_pos_world_3=ZERO_3,
        target_vel_world_3=ZERO_3,
        clearance_m=clearance_m,
        collisions=collisions,
        target_distance_m=distance_m,
        target_path_m=path_m,
        target_arrived=arrived,
        target_visible=visible,
        moving=BoxesView(centre_world_B3=np.zeros((0, 3)), size_m_B3=np.zeros((0, 3)), yaw_rad_B=np.zeros(0)),
        goal_world_3=goal_world_3,
    )


def flown(**last: float | bool) -> FlightRecord:
    """A clean chase of 40 m in 13.4 s; the last sample may differ."""
    record = FlightRecord(40.0)
    record.saw_mode(pb.MODE_READY)
    record.saw_mode(pb.MODE_TAKEOFF)
    record.saw_truth(truth(0.0, clearance_m=0.3))
    record.saw_mode(pb.MODE_TRACK)
    for k in range(1, 134):
        record.saw_truth(truth(0.1 * k, path_m=0.3 * (k - 1), x_m=0.3 * k))
    settings: dict[str, float | bool] = {"path_m": 40.0, "x_m": 40.2, **last}
    record.saw_truth(truth(13.4, **settings))  # pyright: ignore[reportArgumentType]
    return record


def landed(record: FlightRecord) -> Summary:
    record.saw_mode(pb.MODE_STOPPING)
    record.saw_mode(pb.MODE_LANDED)
    return record.summary()


def test_a_clean_chase_succeeds_and_its_figures_are_right() -> None:
    summary = landed(flown())
    assert summary.succeeded
    assert summary.problems == ()
    assert summary.tracked_s == pytest.approx(13.3)
    assert summary.target_path_m == 40.0
    assert summary.vehicle_path_m == pytest.approx(39.9)
    assert summary.mean_speed_mps == pytest.approx(3.0)
    assert summary.in_view_fraction == 1.0
    assert summary.target_distance_end_m == 5.0
    assert summary.collisions == 0


def test_clearance_counts_only_while_tracking() -> None:
    assert landed(flown(clearance_m=0.7)).min_clearance_m == pytest.approx(0.7)


def test_a_target_too_far_away_at_the_end_is_a_failure() -> None:
    summary = landed(flown(distance_m=12.5))
    assert not summary.succeeded
    assert "12.5 m away" in summary.problems[0]


def test_a_target_unseen_for_over_a_second_at_the_end_is_a_failure() -> None:
    record = FlightRecord(40.0)
    record.saw_mode(pb.MODE_TRACK)
    record.saw_truth(truth(0.0))
    record.saw_truth(truth(0.9, visible=False))
    record.saw_truth(truth(1.2, visible=False, path_m=40.0))
    summary = landed(record)
    assert not summary.succeeded
    assert "1.2 s" in summary.problems[0]


def test_a_target_unseen_for_less_than_a_second_is_fine() -> None:
    assert landed(flown(visible=False)).succeeded


def test_a_collision_is_a_failure_even_if_all_else_is_well() -> None:
    summary = landed(flown(collisions=1))
    assert not summary.succeeded
    assert summary.problems == ("it collided 1 time",)


def test_contacts_before_takeoff_do_not_count() -> None:
    record = FlightRecord(1.0)
    record.saw_mode(pb.MODE_READY)
    record.saw_truth(truth(0.0, collisions=2))
    record.saw_mode(pb.MODE_TRACK)
    record.saw_truth(truth(1.0, collisions=2, path_m=1.0))
    assert landed(record).succeeded


def test_a_collision_while_landing_still_counts() -> None:
    record = flown()
    record.saw_mode(pb.MODE_STOPPING)
    record.saw_truth(truth(15.0, collisions=1))
    assert record.collided
    assert not landed(record).succeeded


def test_not_landing_is_a_failure() -> None:
    record = flown()
    record.saw_mode(pb.MODE_STOPPING)
    summary = record.summary()
    assert not summary.succeeded
    assert "did not land" in summary.problems[-1]


def test_never_taking_off_is_a_failure_with_no_figures() -> None:
    record = FlightRecord(40.0)
    record.saw_mode(pb.MODE_IDLE)
    summary = record.summary()
    assert summary.problems == ("it never took off",)
    assert summary.mean_speed_mps is None
    assert summary.min_clearance_m is None


def test_a_chase_cut_short_says_how_far_the_target_got() -> None:
    record = FlightRecord(40.0)
    record.saw_mode(pb.MODE_TRACK)
    record.saw_truth(truth(0.0))
    record.saw_truth(truth(5.0, path_m=15.0))
    assert "15 of 40 m" in landed(record).problems[0]


def test_trouble_outside_the_flight_is_a_failure() -> None:
    record = flown()
    record.saw_mode(pb.MODE_LANDED)
    summary = record.summary(("sim ended by itself",))
    assert not summary.succeeded
    assert summary.problems == ("sim ended by itself",)


def test_a_fault_is_a_failure() -> None:
    record = flown()
    record.saw_mode(pb.MODE_FAULT)
    record.saw_mode(pb.MODE_LANDED)
    assert not record.summary().succeeded


def test_nothing_after_the_arrival_changes_the_chases_figures() -> None:
    record = flown()
    before = record.summary()
    record.saw_truth(truth(20.0, distance_m=90.0, visible=False, speed_mps=50.0))
    after = record.summary()
    assert (after.max_speed_mps, after.target_distance_end_m) == (before.max_speed_mps, before.target_distance_end_m)


def navigated(to_m: float) -> Summary:
    """A navigation of 90 m at 3 m/s that ends ``to_m`` from its start."""
    record = FlightRecord(90.0, navigates=True)
    record.saw_mode(pb.MODE_TAKEOFF)
    record.saw_truth(truth(0.0, goal_world_3=np.array([90.0, 0.0, -1.0])))
    record.saw_mode(pb.MODE_NAVIGATE)
    for k in range(int(to_m / 0.3) + 1):
        # Who runs is nobody's business here.
        record.saw_truth(truth(0.1 * k, x_m=0.3 * k, arrived=True, goal_world_3=np.array([90.0, 0.0, -1.0])))
    return landed(record)


def test_a_navigation_succeeds_at_its_goal_whatever_the_grounds_height_there() -> None:
    summary = navigated(90.0)
    assert summary.succeeded
    assert summary.goal_distance_end_m == pytest.approx(1.8)
    assert summary.vehicle_path_m == pytest.approx(88.2)
    assert (summary.target_distance_end_m, summary.in_view_fraction) == (None, None)


def test_a_navigation_that_ends_before_its_goal_says_how_far() -> None:
    assert navigated(50.0).problems == ("the goal was 40 m away at the end",)
