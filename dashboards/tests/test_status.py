"""What the panels say."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from goshawk_dashboards.live import link
from goshawk_dashboards.page import status
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import CommandView, EventView
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]


def test_a_fresh_flight_shows_mode_and_figures(snap: Make) -> None:
    words = status.status_html(snap())
    assert 'data-mode="track"' in words
    assert 'data-stale="false"' in words
    assert "5.0 m/s" in words
    assert "2.0 m" in words


def test_silence_is_shown_as_stale_with_its_age(snap: Make) -> None:
    words = status.status_html(snap(age_s=3.2))
    assert 'data-stale="true"' in words
    assert "STALE 3.2 s" in words


def test_no_vehicle_says_what_is_being_dialled(snap: Make) -> None:
    words = status.status_html(snap(control=None, health=None, channels=(), linked=False))
    assert "NO VEHICLE" in words
    assert "tcp/127.0.0.1:7447" in words


def test_the_fallback_rung_is_shown(snap: Make) -> None:
    base = snap()
    assert base.control is not None
    words = status.status_html(replace(base, control=replace(base.control, fallback=pb.FALLBACK_PLAN_EXPIRED_BRAKE)))
    assert "fallback: plan expired brake" in words


def test_what_is_not_ready_is_listed_with_its_reason(snap: Make) -> None:
    base = snap()
    assert base.health is not None
    check = replace(base.health.checks[0], ok=False, reason="no odometry for 3 s")
    unready = replace(base, health=replace(base.health, ready=False, checks=(check,)))
    assert "no odometry for 3 s" in status.readiness_html(unready)
    assert status.failing_checks(unready) == ["odometry: no odometry for 3 s"]
    assert status.failing_checks(base) == []


def test_a_silent_vehicle_is_never_ready(snap: Make) -> None:
    assert status.failing_checks(snap(age_s=9.0))
    assert status.failing_checks(snap(health=None))


def test_text_from_outside_is_never_markup(snap: Make) -> None:
    evil = "<script>alert(1)</script>"
    base = snap()
    assert base.health is not None
    health = replace(
        base.health,
        faults=(evil,),
        autopilot=evil,
        version=evil,
        checks=(replace(base.health.checks[0], name=evil, reason=evil),),
        rates_hz=((evil, 1.0),),
        drops=((evil, 1),),
        profile=evil,
    )
    hostile = replace(
        base,
        vehicle=evil,
        endpoint=evil,
        health=health,
        events=(EventView(stamp_ns=1, severity=pb.SEVERITY_ERROR, kind=evil, text=evil),),
        command=CommandView(verb=evil, command_id="1", answered=True, accepted=False, text=evil, mode=None),
    )
    render = (
        status.status_html,
        status.readiness_html,
        link.link_html,
        status.vehicle_html,
        status.events_html,
        status.command_html,
    )
    for words in (f(hostile) for f in render):
        assert "<script" not in words and "&lt;script&gt;" in words


def test_loss_and_malformed_payloads_are_shown(snap: Make) -> None:
    base = snap()
    lossy = replace(base.channels[0], loss_fraction=0.25, malformed=4)
    words = link.link_html(replace(base, channels=(lossy,)))
    assert "25.0 %" in words
    assert "4 malformed" in words


def test_a_vehicle_that_answers_no_question_is_told_from_one_that_was_not_asked(snap: Make) -> None:
    assert "no answer" in link.link_html(replace(snap(), round_trip_s=math.inf))
    assert "no answer" not in link.link_html(replace(snap(), round_trip_s=None))


def test_what_was_learnt_in_flight_is_shown_with_its_unit(snap: Make) -> None:
    words = status.learnt_html(snap())
    assert "hover thrust, learnt" in words and "31.4 %" in words
    assert "attitude lag, learnt" in words and "84 ms" in words
    assert "opacity" not in words
    assert "opacity" in status.learnt_html(snap(age_s=3.0))


def test_what_a_vehicle_does_not_say_of_itself_is_not_made_up(snap: Make) -> None:
    base = snap()
    assert base.control is not None
    silent = replace(base, control=replace(base.control, hover_thrust=None, attitude_lag_s=None))
    assert "learnt</td>" not in status.learnt_html(silent)
    assert status.learnt_html(snap(control=None)) == ""


def test_a_refused_command_shows_why(snap: Make) -> None:
    command = CommandView(
        verb="start", command_id="1", answered=True, accepted=False, text="no camera", mode=pb.MODE_IDLE
    )
    words = status.command_html(snap(command=command))
    assert "start refused" in words
    assert "no camera" in words


def event(at_s: float, text: str) -> EventView:
    """Told at a time of the vehicle's."""
    return EventView(stamp_ns=round(at_s * 1e9), severity=pb.SEVERITY_INFO, kind="mode", text=text)


def test_modes_that_flap_are_two_lines_counted_and_not_a_list(snap: Make) -> None:
    flapping = tuple(event(float(k), ("mode: search", "mode: track")[k % 2]) for k in range(20))
    groups = status.grouped((event(0.0, "mode: takeoff"), *flapping, event(30.0, "target unseen for 3.5 s"),
                             event(31.0, "target unseen for 4.5 s")))  # fmt: skip
    assert [(e.text, count) for e, count in groups] == [
        ("target unseen for 4.5 s", 2), ("mode: track", 10), ("mode: search", 10), ("mode: takeoff", 1)
    ]  # fmt: skip
    assert "&times;&thinsp;10" in status.events_html(snap(events=flapping))


def test_an_event_is_told_by_the_flights_time_and_before_it_by_how_long_ago_it_was(snap: Make) -> None:
    told = snap(events=(event(0.2, "mode: ready"), event(0.9, "mode: track")))
    assert "1 s ago" in status.events_html(told)
    words = status.events_html(replace(told, events=(event(90.5, "mode: track"),)), took_off_ns=20_000_000_000)
    assert "1:10" in words


def test_an_event_that_was_told_afterwards_says_so(snap: Make) -> None:
    heard, late = event(0.2, "mode: ready"), replace(event(0.1, "camera: silent"), late=True)
    words = status.events_html(snap(events=(late, heard)))
    assert words.count("told afterwards") == 1
    assert words.index("mode: ready") < words.index("camera: silent") < words.index("told afterwards")


def test_height_is_above_the_ground_where_that_is_known_and_says_where_it_is_not(snap: Make) -> None:
    known = status.status_html(snap(), ground_z_m=-0.5, flight_s=65.0)
    assert "above ground" in known and ">2.5 m<" in known and ">1:05<" in known
    assert "height, from its origin" in status.status_html(snap())
