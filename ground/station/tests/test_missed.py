"""What a ground missed: found by numbers and gaps, asked for page by page, behind every Stop, and told in its place."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from goshawk_dashboards.log.flight import Flight
from goshawk_ground.link import GroundLink
from goshawk_ground.link.missed import BEFORE_S, EVENTS_BEYOND, GAPS, STEPS, STOOD_S, Missed
from goshawk_ground.link.recording import record
from goshawk_proto import KEYS, PROTOCOL, key_expression
from goshawk_proto import goshawk_pb2 as pb

SECOND = 1_000_000_000


def beat(at_s: float, events: int = 0, session: int = 7) -> pb.Health:
    return pb.Health(
        vehicle="goshawk", stamp_ns=round(at_s * SECOND), session=session, events=events, protocol=PROTOCOL,
        mode=pb.MODE_READY,
    )  # fmt: skip


def event(seq: int, at_s: float) -> pb.Event:
    return pb.Event(seq=seq, stamp_ns=round(at_s * SECOND), severity=pb.SEVERITY_WARNING, kind="k", text=f"event {seq}")


def step(at_s: float) -> pb.Control:
    return pb.Control(stamp_ns=round(at_s * SECOND), world_from_body=pb.Quat(w=1.0), mode=pb.MODE_READY)


def target(at_s: float) -> pb.Target:
    return pb.Target(
        stamp_ns=round(at_s * SECOND), confirmed=True, pos_world=pb.Vec3(x=at_s), covariance_upper=[1.0] * 21
    )


def asked_of(missed: Missed) -> pb.MissedRequest:
    asked = missed.request()
    assert asked is not None
    return asked


def caught_up(missed: Missed, events: int = 0) -> Missed:
    """It has heard a heartbeat, and been told all before."""
    missed.heard_health(beat(10.0, events))
    asked = asked_of(missed)
    assert missed.take(asked, pb.Missed(session=7, events=[event(k + 1, 1.0) for k in range(events)]))
    assert missed.request() is None
    return missed


def test_a_ground_that_opens_late_asks_for_all_that_was_before_it() -> None:
    missed = Missed()
    missed.heard_health(beat(10.0, events=3))
    assert missed.request() == pb.MissedRequest(session=7, before_ns=10 * SECOND)


def test_of_a_long_time_before_it_opened_a_ground_asks_for_the_end() -> None:
    missed = Missed()
    missed.heard_health(beat(1000.0))
    asked = asked_of(missed)
    assert (asked.after_ns, asked.before_ns) == (round((1000.0 - BEFORE_S) * SECOND), 1000 * SECOND)


def test_of_a_take_off_long_before_it_opened_a_ground_asks_for_the_second_in_which_it_stood() -> None:
    missed = Missed()
    missed.heard_health(beat(1000.0, events=3))
    asked = asked_of(missed)
    events = [event(1, 90.0), event(2, 300.0), event(3, 301.0)]
    for took_off in events[:2]:
        took_off.kind, took_off.text = "mode", "Ready → Takeoff: start accepted"
    assert missed.take(asked, pb.Missed(session=7, events=events))
    asked = asked_of(missed)
    assert (asked.after_ns, asked.before_ns) == (round((300.0 - STOOD_S) * SECOND), 300 * SECOND), "of the last of them"
    assert missed.take(asked, pb.Missed(session=7, controls=[step(299.5)]))
    assert missed.request() is None


def test_of_a_vehicle_that_was_heard_all_the_while_nothing_is_asked() -> None:
    missed = caught_up(Missed(), events=2)
    for k in range(20):
        missed.heard_event(3 + k)
        missed.heard_health(beat(10.5 + 0.5 * k, events=3 + k))
        assert missed.request() is None


def test_after_a_cut_its_seconds_and_the_events_that_are_lacking_are_asked_for() -> None:
    missed = caught_up(Missed(), events=2)
    missed.heard_event(6)
    missed.heard_health(beat(40.0, events=6))
    asked = asked_of(missed)
    assert asked == pb.MissedRequest(session=7, after_event=2, after_ns=10 * SECOND, before_ns=40 * SECOND)
    page = pb.Missed(session=7, events=[event(k, 20.0) for k in (3, 4, 5)], controls=[step(25.0)], more=True)
    assert missed.take(asked, page)
    asked = asked_of(missed)
    assert asked == pb.MissedRequest(session=7, after_event=6, after_ns=25 * SECOND, before_ns=40 * SECOND)
    assert missed.take(asked, pb.Missed(session=7, controls=[step(30.0)]))
    assert missed.request() is None


def test_events_that_the_vehicle_no_longer_keeps_are_not_asked_for_again() -> None:
    missed = Missed()
    missed.heard_health(beat(10.0, events=1000))
    asked = asked_of(missed)
    kept = [event(k, 9.0) for k in range(801, 901)]
    assert missed.take(asked, pb.Missed(session=7, dropped_events=800, events=kept, more=True))
    asked = asked_of(missed)
    assert asked.after_event == 900
    assert missed.take(asked, pb.Missed(session=7, events=[event(k, 9.0) for k in range(901, 1001)]))
    assert missed.request() is None


def test_a_page_that_claims_too_much_takes_no_time_and_one_that_brings_nothing_is_no_answer() -> None:
    missed = Missed()
    missed.heard_health(beat(10.0, events=5))
    asked = asked_of(missed)
    assert not missed.take(asked, pb.Missed(session=7, more=True))
    assert missed.take(asked, pb.Missed(session=7, dropped_events=2**63, more=True, healths=[beat(9.0)]))
    assert asked_of(missed).after_event == 5, "no more than were told"


def test_a_vehicle_that_was_started_anew_counts_from_one_again() -> None:
    missed = caught_up(Missed(), events=5)
    missed.heard_health(beat(10.5, events=2, session=8))
    assert missed.request() == pb.MissedRequest(session=8)


def test_a_vehicle_that_cannot_tell_is_not_asked() -> None:
    missed = Missed()
    missed.heard_health(beat(10.0, session=0))
    missed.heard_health(beat(90.0, session=0))
    assert missed.request() is None


def test_a_step_or_a_target_that_was_heard_is_not_told_again() -> None:
    missed = caught_up(Missed())
    missed.heard_step(step(10.2).stamp_ns)
    missed.heard_target(target(10.3).stamp_ns)
    missed.heard_health(beat(20.0))
    asked = asked_of(missed)
    page = pb.Missed(session=7, controls=[step(10.2), step(10.4)], targets=[target(10.3), target(10.5)])
    assert missed.take(asked, page)
    assert (list(page.controls), list(page.targets)) == ([step(10.4)], [target(10.5)])


def test_a_flickering_link_and_a_flood_of_events_fill_no_memory() -> None:
    missed = Missed()
    for k in range(10_000):
        missed.heard_health(beat(10.0 * k))
        missed.heard_event(2 * k + 2)
        missed.heard_step(k)
        missed.heard_target(k)
    assert missed.held <= 2 * GAPS + 2 * STEPS + EVENTS_BEYOND


class Vehicle:
    """Answers Stop when it is let, and what was missed; notes in which order it was asked."""

    def __init__(self, endpoint: str) -> None:
        config = zenoh.Config()
        for key, value in {
            "mode": '"peer"', "listen/endpoints": f'["{endpoint}"]', "scouting/multicast/enabled": "false",
        }.items():  # fmt: skip
            config.insert_json5(key, value)
        self.asked: list[str] = []
        self.stop_answered = threading.Event()
        self.session = zenoh.open(config)
        self._kept = [
            self.session.declare_queryable(key_expression(name, "goshawk"), answer)
            for name, answer in (("cmd_stop", self._stop), ("missed", self._missed))
        ]
        self._token = self.session.liveliness().declare_token(key_expression("alive_air", "goshawk"))

    def _stop(self, query: zenoh.Query) -> None:
        self.asked.append("stop")
        if self.stop_answered.is_set():
            asked = pb.StopRequest.FromString(query.payload.to_bytes() if query.payload else b"")
            reply = pb.CommandReply(command_id=asked.command_id, accepted=True, reason="not flying", mode=pb.MODE_READY)
            query.reply(query.key_expr, reply.SerializeToString())

    def _missed(self, query: zenoh.Query) -> None:
        self.asked.append("missed")
        asked = pb.MissedRequest.FromString(query.payload.to_bytes() if query.payload else b"")
        steps = [s for s in (step(11.0), step(12.0)) if asked.after_ns < s.stamp_ns < asked.before_ns]
        page = pb.Missed(
            session=7, events=[event(1, 1.0), event(2, 12.0)], controls=steps,
            targets=[target(s.stamp_ns / SECOND) for s in steps],
        )  # fmt: skip
        query.reply(query.key_expr, page.SerializeToString())

    def put(self, name: str, message: pb.Health | pb.Event | pb.Control) -> None:
        self.session.put(
            key_expression(name, "goshawk"), message.SerializeToString(), priority=KEYS[name].priority,
        )  # fmt: skip

    def close(self) -> None:
        self.session.close()


@pytest.fixture
def vehicle(free_endpoint: str) -> Iterator[Vehicle]:
    vehicle = Vehicle(free_endpoint)
    yield vehicle
    vehicle.close()


def test_what_was_missed_is_asked_for_when_the_stop_is_answered_and_stands_in_its_place(
    vehicle: Vehicle, free_endpoint: str
) -> None:
    with GroundLink(connect=free_endpoint) as link:
        assert link.wait_for(lambda s: s.alive, 10.0)
        link.press_stop()
        vehicle.put("event", event(3, 20.0))
        vehicle.put("health", beat(21.0, events=3))
        assert link.wait_for(lambda s: s.health is not None, 10.0)
        time.sleep(2.5)  # long enough to ask five times
        assert vehicle.asked.count("stop") > 5
        assert "missed" not in vehicle.asked
        vehicle.stop_answered.set()
        told = link.wait_for(lambda s: len(s.events) == 3, 10.0)
        assert told is not None and told.stop is None
        assert [(e.text, e.late) for e in told.events] == [("event 1", True), ("event 2", True), ("event 3", False)]
        assert [view.stamp_ns for view in told.late] == [11 * SECOND, 11 * SECOND, 12 * SECOND, 12 * SECOND]
        assert told.control is None and told.target is None, "what was told afterwards is not what is now"
        assert vehicle.asked.count("missed") == 1


def test_a_recording_holds_what_was_told_after_a_cut_in_its_place(
    vehicle: Vehicle, free_endpoint: str, tmp_path: Path
) -> None:
    path, ended = tmp_path / "heard.mcap", threading.Event()  # type: ignore[operator]
    with GroundLink(connect=free_endpoint) as link:
        assert link.wait_for(lambda s: s.alive, 10.0)
        writing = threading.Thread(target=record, args=(link, path, ended.is_set), daemon=True)
        writing.start()
        time.sleep(0.3)
        vehicle.put("health", beat(10.0))
        assert link.wait_for(lambda s: s.health is not None, 10.0)
        vehicle.put("health", beat(21.0, events=2))
        assert link.wait_for(lambda s: len(s.events) == 2, 10.0)
        time.sleep(0.5)
        ended.set()
        writing.join()
    flight = Flight.open(path)
    assert [e.text for e in flight.events] == ["event 2"], "the first was before the recording"
    assert flight.times_s("control").tolist() == flight.times_s("target").tolist() == [1.0, 2.0]


def test_a_vehicle_that_boots_anew_is_recorded_in_a_file_of_its_own(
    vehicle: Vehicle, free_endpoint: str, tmp_path: Path
) -> None:
    ended = threading.Event()
    counts: list[int] = []
    with GroundLink(connect=free_endpoint) as link:
        assert link.wait_for(lambda s: s.alive, 10.0)
        writing = threading.Thread(
            target=lambda: counts.append(record(link, tmp_path / "heard.mcap", ended.is_set)), daemon=True
        )
        writing.start()
        time.sleep(0.3)
        for told in (beat(100.0), beat(101.0), beat(102.0, session=8), beat(4.0, session=9), beat(5.0, session=9)):
            vehicle.put("health", told)
        assert link.wait_for(lambda s: s.health is not None and s.health.stamp_ns == 5 * SECOND, 10.0)
        vehicle.put("control", step(5.5))
        assert link.wait_for(lambda s: s.control is not None, 10.0)
        time.sleep(0.5)
        ended.set()
        writing.join()
    first, second = Flight.open(tmp_path / "heard.mcap"), Flight.open(tmp_path / "heard-2.mcap")
    assert first.times_s("health").tolist() == [0.0, 1.0, 2.0], "a process that starts again goes by the same clock"
    assert (second.times_s("health").tolist(), second.times_s("control").tolist()) == ([0.0, 1.0], [1.5])
    assert (second.count("header"), counts) == (1, [first.count("health") + second.count("health") + 1])
