"""What the demo decides, as a pure function of time and facts."""

from __future__ import annotations

from typing import Any

import pytest
from goshawk_ground.demo.director import STOPPED, Action, Director, Limits, Phase
from goshawk_proto import goshawk_pb2 as pb

LIMITS = Limits(ready_s=60, takeoff_s=30, chase_s=70, landing_s=45)


class Rehearsal:
    """A director and its clock."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.director = Director(LIMITS, 0.0)

    def at(self, seconds: float, mode: pb.Mode | None, **facts: Any) -> Action:
        self.now_s += seconds
        known: dict[str, Any] = {"ready": False, "arrived": False, "collided": False, **facts}
        return self.director.step(self.now_s, mode=mode, **known)

    def chasing(self) -> Rehearsal:
        assert self.at(1, pb.MODE_READY, ready=True) is Action.START
        assert self.at(1, pb.MODE_TAKEOFF, ready=True) is Action.WAIT
        assert self.at(1, pb.MODE_TRACK, ready=True) is Action.WAIT
        assert self.director.phase is Phase.UNDER_WAY
        return self


@pytest.fixture
def rehearsal() -> Rehearsal:
    return Rehearsal()


def test_a_whole_flight_starts_and_stops_once(rehearsal: Rehearsal) -> None:
    r = rehearsal.chasing()
    assert r.at(5, pb.MODE_SEARCH) is Action.WAIT
    assert r.at(5, pb.MODE_TRACK, arrived=True) is Action.STOP
    assert r.at(1, pb.MODE_TRACK, arrived=True) is Action.WAIT
    assert r.at(1, pb.MODE_STOPPING, arrived=True) is Action.WAIT
    assert r.at(1, pb.MODE_LANDED, arrived=True) is Action.END
    assert r.at(1, pb.MODE_LANDED, arrived=True) is Action.END
    assert r.director.failure is None


def test_it_waits_for_readiness_and_for_the_mode(rehearsal: Rehearsal) -> None:
    assert rehearsal.at(1, None) is Action.WAIT
    assert rehearsal.at(1, pb.MODE_IDLE) is Action.WAIT
    assert rehearsal.at(1, pb.MODE_IDLE, ready=True) is Action.WAIT
    assert rehearsal.at(1, pb.MODE_READY, ready=True) is Action.START


def test_never_ready_ends_with_the_reason(rehearsal: Rehearsal) -> None:
    assert rehearsal.at(61, pb.MODE_IDLE, why_not_ready="camera: no frames") is Action.END
    assert rehearsal.director.failure == "not ready after 60 s: camera: no frames"


def test_a_refused_start_ends(rehearsal: Rehearsal) -> None:
    assert rehearsal.at(1, pb.MODE_READY, ready=True) is Action.START
    rehearsal.director.refused(rehearsal.now_s, "battery low")
    assert rehearsal.at(0.1, pb.MODE_READY, ready=True) is Action.END
    assert rehearsal.director.failure == "start was not accepted: battery low"


@pytest.mark.parametrize(
    ("seconds", "mode", "facts", "words"),
    [
        (1, pb.MODE_TRACK, {"collided": True}, "collision"),
        (1, pb.MODE_LANDED, {}, "ended by itself"),
        (1, pb.MODE_FAULT, {}, "ended by itself"),
        (1, None, {}, "ended by itself"),
        (71, pb.MODE_TRACK, {}, "nobody arrived"),
    ],
)
def test_trouble_in_the_chase_stops_the_flight(
    rehearsal: Rehearsal, seconds: float, mode: pb.Mode | None, facts: dict[str, bool], words: str
) -> None:
    r = rehearsal.chasing()
    assert r.at(seconds, mode, **facts) is Action.STOP
    assert r.director.failure is not None
    assert words in r.director.failure
    assert r.at(1, pb.MODE_LANDED) is Action.END


def test_a_takeoff_that_does_not_lead_to_tracking_is_stopped(rehearsal: Rehearsal) -> None:
    rehearsal.at(1, pb.MODE_READY, ready=True)
    assert rehearsal.at(31, pb.MODE_TAKEOFF) is Action.STOP
    assert rehearsal.director.failure == "not under way 30 s after start (mode takeoff)"


def test_a_flight_that_somebody_stops_lands_and_is_called_stopped(rehearsal: Rehearsal) -> None:
    r = rehearsal.chasing()
    assert r.at(1, pb.MODE_STOPPING, stopped=True) is Action.WAIT
    assert r.at(1, pb.MODE_LANDED, stopped=True) is Action.END
    assert r.director.failure == STOPPED


def test_a_flight_that_somebody_else_has_started_is_followed_from_its_take_off() -> None:
    director = Director(LIMITS, 0.0, Phase.TAKING_OFF)
    for at_s, mode in ((1.0, pb.MODE_TAKEOFF), (2.0, pb.MODE_NAVIGATE)):
        assert director.step(at_s, mode=mode, ready=False, arrived=False, collided=False) is Action.WAIT
    assert director.phase is Phase.UNDER_WAY


def test_a_landing_that_never_ends_ends_the_demo(rehearsal: Rehearsal) -> None:
    r = rehearsal.chasing()
    assert r.at(1, pb.MODE_TRACK, arrived=True) is Action.STOP
    assert r.at(46, pb.MODE_STOPPING, arrived=True) is Action.END
    assert r.director.failure == "not landed 45 s after stop (mode stopping)"


def test_the_first_failure_is_the_one_told(rehearsal: Rehearsal) -> None:
    r = rehearsal.chasing()
    assert r.at(1, pb.MODE_TRACK, collided=True) is Action.STOP
    assert r.at(46, pb.MODE_STOPPING) is Action.END
    assert r.director.failure == "collision"
