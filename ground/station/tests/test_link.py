"""The ground's link over real Zenoh, with a vehicle in another process."""

from __future__ import annotations

import json
import math
import threading
import time
from collections.abc import Callable
from typing import Any

import pytest
import zenoh
from google.protobuf.message import Message
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.link import GroundLink, LinkError
from goshawk_ground.link.dial import Way
from goshawk_proto import KEYS, PROTOCOL, key_expression
from goshawk_proto import goshawk_pb2 as pb

Fakes = Callable[..., Any]
CHANNELS = {"control", "health", "preview", "sim_truth"}


def channel(snap: Snapshot, name: str) -> Any:
    return next(c for c in snap.channels if c.name == name)


def ready(snap: Snapshot) -> bool:
    return snap.health is not None and snap.health.ready and snap.mode == pb.MODE_READY


def test_a_flight_begins_and_ends_by_command(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle().endpoint) as link:
        assert link.wait_for(ready, 10)
        started = link.start("fast")
        assert (started.answered, started.accepted, started.mode) == (True, True, pb.MODE_TAKEOFF)
        tracking = link.wait_for(lambda s: s.mode == pb.MODE_TRACK and s.plan is not None and s.target is not None, 10)
        assert tracking is not None
        assert tracking.plan is not None
        assert len(tracking.plan.cost_N) == 15
        assert tracking.alive
        stopped = link.stop()
        assert stopped.accepted
        assert link.wait_for(lambda s: s.mode == pb.MODE_LANDED, 10)
        assert link.snapshot().command == stopped
        assert any("landed" in e.text for e in link.snapshot().events)


def test_a_refusal_says_why(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle("--not-ready").endpoint) as link:
        reply = link.start()
        assert (reply.answered, reply.accepted) == (True, False)
        assert "odometry" in reply.text


def test_no_vehicle_is_no_reply_in_time_and_says_what_to_check(free_endpoint: str) -> None:
    with GroundLink(connect=free_endpoint) as link:
        before = time.monotonic()
        reply = link.start(timeout_s=0.6)
        assert time.monotonic() - before < 2.0
        assert not reply.answered
        assert free_endpoint in reply.text
        assert "--connect" in reply.text


def test_a_wrong_name_is_told_from_a_missing_vehicle(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle().endpoint, vehicle="stranger") as link:
        reply = link.stop(timeout_s=2.0)
        assert not reply.answered
        assert "no vehicle named 'stranger' is there" in reply.text
        assert not link.snapshot().alive


def test_a_mute_vehicle_is_told_from_a_missing_one(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle("--mute").endpoint) as link:
        assert link.wait_for(lambda s: s.alive, 10)
        reply = link.stop(timeout_s=1.0)
        assert not reply.answered
        assert "is there and does not answer" in reply.text
        assert link.wait_for(lambda s: s.round_trip_s == math.inf, 10)


def test_loss_is_computed_from_seq(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle("--lose", "0.3").endpoint) as link:
        assert link.wait_for(lambda s: channel(s, "control").count > 180, 20)
        assert 0.18 < channel(link.snapshot(), "control").loss_fraction < 0.45


def test_malformed_payloads_are_counted_and_hurt_nothing(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle("--malformed").endpoint) as link:
        snap = link.wait_for(
            lambda s: all(channel(s, n).malformed > 5 for n in ("plan", "control", "health")) and s.health is not None,
            10,
        )
        assert snap is not None
        assert snap.fresh("control", 0.5)
        assert link.start().answered


def test_two_grounds_see_the_same_and_either_may_command(fake_vehicle: Fakes) -> None:
    endpoint = fake_vehicle().endpoint
    with GroundLink(connect=endpoint) as one, GroundLink(connect=endpoint) as two:
        assert one.wait_for(ready, 10)
        assert two.wait_for(ready, 10)
        assert one.start().accepted
        assert two.wait_for(lambda s: s.mode == pb.MODE_TRACK, 10)
        second = two.start()
        assert (second.accepted, second.text) == (False, "already flying")
        assert two.stop().accepted
        assert one.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 10)


def test_one_ground_leaving_does_not_disturb_the_other(fake_vehicle: Fakes) -> None:
    endpoint = fake_vehicle().endpoint
    with GroundLink(connect=endpoint) as one:
        with GroundLink(connect=endpoint) as two:
            assert two.wait_for(ready, 10)
        assert one.wait_for(ready, 10)
        count = channel(one.snapshot(), "control").count
        assert one.wait_for(lambda s: channel(s, "control").count > count + 20 and s.alive, 5)


def test_a_ground_started_first_finds_its_vehicle(fake_vehicle: Fakes, free_endpoint: str) -> None:
    with GroundLink(connect=free_endpoint) as link:
        time.sleep(0.5)
        assert not link.snapshot().linked
        fake_vehicle(endpoint=free_endpoint)
        assert link.wait_for(ready, 15)


def test_a_killed_vehicle_goes_stale_and_its_return_is_noticed(fake_vehicle: Fakes) -> None:
    fake = fake_vehicle()
    with GroundLink(connect=fake.endpoint) as link:
        assert link.wait_for(ready, 10)
        fake.kill()
        assert link.wait_for(lambda s: not s.linked and not s.alive and not s.fresh("control", 1.0), 10)
        assert link.snapshot().control is not None
        fake_vehicle(endpoint=fake.endpoint)
        assert link.wait_for(lambda s: ready(s) and s.alive and s.fresh("control", 0.5), 15)
        assert link.start().accepted


def test_the_simulators_trees_are_fetched(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle("--seed", "5").endpoint) as link:
        snap = link.wait_for(lambda s: s.world is not None, 10)
        assert snap is not None
        assert snap.world is not None
        assert snap.world.seed == 5
        assert len(snap.world.radius_m_K) > 20


def test_another_simulators_trees_take_the_place_of_the_first_ones(fake_vehicle: Fakes) -> None:
    first = fake_vehicle("--seed", "5")
    with GroundLink(connect=first.endpoint) as link:
        assert link.wait_for(lambda s: s.world is not None and s.world.seed == 5, 10)
        first.kill()
        fake_vehicle("--seed", "6", "--clock", "20", endpoint=first.endpoint)
        assert link.wait_for(lambda s: s.world is not None and s.world.seed == 6, 20)


def test_a_link_that_comes_up_after_it_was_closed_is_closed_too(
    free_endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    closing, opened, closed = threading.Event(), threading.Event(), threading.Event()

    class Session:
        def close(self) -> None:
            closed.set()

    def late(self: Way, giving_up: threading.Event) -> Session:
        opened.set()
        closing.wait(10.0)
        return Session()

    monkeypatch.setattr(Way, "open", late)
    link = GroundLink(connect=free_endpoint)
    assert opened.wait(10.0)
    link.close()
    closing.set()
    assert closed.wait(10.0)


def test_with_keys_a_vehicles_name_is_no_longer_than_a_certificate_holds() -> None:
    with pytest.raises(LinkError, match="at most 32 characters"):
        GroundLink(vehicle="a" * 64, connect="tls/127.0.0.1:1")


def test_a_listener_hears_every_sample_until_it_ends(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle().endpoint) as link:
        heard: list[str] = []
        end = link.listen(lambda name, _: heard.append(name))
        assert link.wait_for(lambda _: set(heard) >= CHANNELS, 10)
        end()
        time.sleep(0.1)
        count = len(heard)
        time.sleep(0.3)
        assert len(heard) == count


def test_what_a_vehicle_told_before_it_booted_hides_nothing_that_it_tells_now(free_endpoint: str) -> None:
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([free_endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session, GroundLink(connect=free_endpoint) as link:

        def tells(key: str, message: Message) -> None:
            session.put(key_expression(key, link.vehicle), message.SerializeToString())

        def boots(process: int, uptime_s: int, events: int) -> None:
            for number in range(events):
                stamp_ns = (uptime_s * 1000 + number) * 1_000_000
                tells("health", pb.Health(stamp_ns=stamp_ns, session=process))
                tells("event", pb.Event(stamp_ns=stamp_ns, text=f"{process}: {number}", seq=number + 1))
                time.sleep(0.02)

        assert link.wait_for(lambda _: link.linked, 10)
        boots(1, 3000, 20)
        assert link.wait_for(lambda s: any(event.text == "1: 19" for event in s.events), 10)
        boots(2, 5, 2)
        assert link.wait_for(lambda s: any(event.text == "2: 1" for event in s.events), 10)
        assert {event.text for event in link.snapshot().events} == {"2: 0", "2: 1"}


def test_a_message_that_comes_under_another_key_is_left_out(free_endpoint: str) -> None:
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([free_endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    stray = pb.Event(stamp_ns=7, text="taking off").SerializeToString()
    with zenoh.open(config) as session, GroundLink(connect=free_endpoint) as link:
        assert link.wait_for(lambda _: link.linked, 10)
        health = key_expression("health", link.vehicle)
        own = pb.Health(seq=3, protocol=PROTOCOL).SerializeToString()
        # Zenoh does so, for a while, where a link breaks and comes again at once.
        for _ in range(50):
            session.put(health, own, encoding=KEYS["health"].encoding)
            session.put(health, stray, encoding=KEYS["event"].encoding)
            time.sleep(0.02)
        told = link.snapshot()
        assert told.health is not None and (told.health.seq, told.health.protocol) == (3, PROTOCOL)
        assert next(c.malformed for c in told.channels if c.name == "health") > 0
        session.put(health, pb.Health(seq=4).SerializeToString())
        assert link.wait_for(lambda s: s.health is not None and s.health.seq == 4, 10), "one that names none is read"


@pytest.mark.parametrize("endpoint", ["", "foo", "tcp/", "http/127.0.0.1:1"])
def test_an_endpoint_that_cannot_be_one_is_refused_at_once(endpoint: str) -> None:
    with pytest.raises(LinkError, match="endpoint"):
        GroundLink(connect=endpoint)


@pytest.mark.parametrize("name", ["", "A", "a/b", "a*", "*"])
def test_a_name_that_cannot_be_one_is_refused_at_once(name: str) -> None:
    with pytest.raises(LinkError, match="vehicle name"):
        GroundLink(vehicle=name)


def test_a_ground_that_is_busy_still_sees_what_is_now(fake_vehicle: Fakes) -> None:
    with GroundLink(connect=fake_vehicle().endpoint) as link:
        assert link.wait_for(ready, 10)
        busy = threading.Event()

        def hog() -> None:
            while not busy.is_set():
                sum(range(1000))

        def behind_s() -> float:
            control = link.snapshot().control
            assert control is not None
            return time.monotonic() - control.stamp_ns * 1e-9

        # The two clocks differ by a constant; what matters is that the difference does not grow.
        usual = min(behind_s() for _ in range(50) if time.sleep(0.01) is None)
        threads = [threading.Thread(target=hog, daemon=True) for _ in range(2)]
        for thread in threads:
            thread.start()
        late = sorted(behind_s() - usual for _ in range(30) if time.sleep(0.1) is None)
        busy.set()
        for thread in threads:
            thread.join()
        assert late[len(late) // 2] < 0.3
