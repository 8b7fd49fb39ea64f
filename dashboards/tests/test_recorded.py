"""A recorded instant is the live view's snapshot; marks, plots and tables say what the log says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.log import recorded
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Mark, Replay
from goshawk_dashboards.page.status import learnt_html
from goshawk_dashboards.review import tables
from goshawk_proto import goshawk_pb2 as pb
from made_up import make_plan

DURATION_S = 8.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the made-up logs are."""
    return tmp_path_factory.mktemp("log")


@pytest.fixture(scope="module")
def flight(folder: Path) -> Flight:
    """A made-up flight."""
    return Flight.open(rec.write_flight(folder / "flight.mcap", DURATION_S))


def test_an_instant_is_a_fresh_snapshot_of_that_time(flight: Flight) -> None:
    snap = recorded.snapshot_at(flight, 2.5)
    assert snap.control is not None and snap.plan is not None and snap.preview is not None
    assert snap.mode == pb.MODE_TRACK
    assert snap.fresh("control", 0.01) and snap.fresh("plan", 0.04)
    assert snap.preview.stamp_ns == snap.plan.frame_ns
    assert not snap.stale
    assert snap.health is None and snap.age_s("health") is None


def test_what_was_learnt_in_flight_is_shown_as_it_was_known_then(flight: Flight) -> None:
    words = learnt_html(recorded.snapshot_at(flight, 2.5))
    assert "26.2 %" in words and "71 ms" in words


def test_after_the_last_record_everything_is_stale(flight: Flight) -> None:
    assert recorded.snapshot_at(flight, DURATION_S + 5.0).stale


def test_measured_depth_stands_where_the_camera_was(flight: Flight) -> None:
    plan, found = flight.plan_at(2.0), recorded.depth_points(flight, 2.0)
    assert plan is not None and found is not None
    points_P3, colors_P3 = found
    assert points_P3.shape == colors_P3.shape
    # The made-up camera looks east at a wall 4 m ahead.
    assert np.allclose(points_P3[:, 0] - plan.start_pos_world_3[0], 4.0, atol=0.06)


def test_vectors_turn_as_the_quaternion_says() -> None:
    quarter = np.sqrt(0.5)
    turned = recorded.rotated(np.array([quarter, 0.0, 0.0, quarter]), np.array([[1.0, 0.0, 2.0]]))
    assert np.allclose(turned, [[0.0, 1.0, 2.0]])


def test_trails_end_where_the_vehicle_is(flight: Flight) -> None:
    own_N3, target_N3 = recorded.trails_at(flight, 2.0)
    assert np.allclose(own_N3[0], rec.position(0.0))
    assert np.allclose(own_N3[-1], rec.position(2.0))
    assert len(target_N3) > 0


def test_marks_tell_events_phases_fallbacks_and_the_closest_approach(flight: Flight) -> None:
    marks = recorded.marks_of(flight)
    texts = [m.text for m in marks]
    assert [m.time_s for m in marks] == sorted(m.time_s for m in marks)
    assert {"start accepted", "tracking", "lost", "search", "landing"} <= set(texts)
    assert "fallback: plan expired brake, 0.20 s" in texts
    (closest,) = [m for m in marks if m.text.startswith("closest")]
    assert closest.text == "closest to an obstacle: 0.20 m"
    assert closest.time_s == pytest.approx(np.pi, abs=0.05)


def test_a_collision_is_marked_when_it_was_counted(folder: Path) -> None:
    flight = Flight.open(rec.write_flight(folder / "collision.mcap", 3.0, collides_s=2.0))
    (mark,) = [m for m in recorded.marks_of(flight) if m.text == "collision"]
    assert (mark.severity, mark.time_s) == (pb.SEVERITY_ERROR, pytest.approx(2.0, abs=1e-3))


def test_a_mission_event_is_not_told_twice(folder: Path) -> None:
    flight = Flight.open(rec.write_flight(folder / "told.mcap", 3.0, told="Takeoff → Track: the target is confirmed"))
    texts = [m.text for m in recorded.marks_of(flight)]
    assert "Takeoff → Track: the target is confirmed" in texts
    assert "tracking" not in texts


def test_a_replay_answers_frame_by_frame_and_only_its_own_flight(flight: Flight, folder: Path) -> None:
    replay = Replay(Flight.open(rec.write_replay(folder / "other.mcap", DURATION_S, chosen=3)))
    assert replay.answers(flight)
    plan = flight.plan_at(2.0)
    other = replay.plan_for(plan)
    assert plan is not None and other is not None
    assert other.frame_ns == plan.frame_ns
    assert (plan.chosen, other.chosen) == (7, 3)
    stranger = Replay(Flight.open(rec.write_replay(folder / "stranger.mcap", 1.0, chosen=3, later_s=1e-3)))
    assert not stranger.answers(flight)
    assert stranger.plan_for(plan) is None


def test_only_the_chosen_trajectory_is_left_of_a_plan() -> None:
    one = recorded.only_chosen(make_plan(chosen=7))
    assert one is not None
    assert one.chosen == 0
    assert np.array_equal(one.end_pos_world_N3[0], make_plan().end_pos_world_N3[7])
    assert recorded.only_chosen(make_plan(chosen=None)) is None


def test_candidates_are_laid_out_as_the_lattice_and_say_what_was_flown() -> None:
    html = tables.candidates_html(make_plan(chosen=7), 5, make_plan(chosen=3))
    assert "repeat(5,1fr)" in html
    assert "candidate 8 flown" in html
    assert "the other policy chose 4, " in html
    assert html.count("border:2px solid #fff") == 1
    assert "nothing was eligible" in tables.candidates_html(make_plan(chosen=None), 5, None)
    assert "no plan" in tables.candidates_html(None, 5, None)


def test_texts_of_a_log_are_escaped() -> None:
    html = tables.marks_html([Mark(time_s=0.0, severity=pb.SEVERITY_INFO, text="<script>alert(1)</script>")], 0.0)
    assert "<script>" not in html and "&lt;script&gt;" in html
