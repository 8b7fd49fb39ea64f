"""Floods from a peer that has a certificate, and connections that say nothing: the operator is served beside them."""

from __future__ import annotations

import contextlib
import socket
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from goshawk_ground.link import DEFAULT_VEHICLE
from people import People, everybody
from rig import Rig

CONNECTIONS = 1000
CONNECT_WITHIN_S = 2.0
STOP_WITHIN_S = 1.0


@pytest.fixture
def guarded(rig: Rig) -> Iterator[tuple[Rig, People]]:
    """A ready vehicle with an identity."""
    people = everybody(rig.folder)
    rig.identity = people.of(f"vehicle.{DEFAULT_VEHICLE}")
    rig.air()
    rig.sim("--seed", "3")
    with rig.link(people.of("operator.alice")) as link:
        ready = link.wait_for(lambda s: s.health is not None and s.health.ready, 60.0)
        assert ready is not None, rig.output("air")
    yield rig, people


def idle_connections(port: int) -> list[socket.socket]:
    held: list[socket.socket] = []
    for _ in range(CONNECTIONS):
        with contextlib.suppress(OSError):
            held.append(socket.create_connection(("127.0.0.1", port), timeout=1.0))
    return held


def test_the_operator_connects_and_stops_beside_a_thousand_silent_connections(guarded: tuple[Rig, People]) -> None:
    rig, people = guarded
    held = idle_connections(rig.zenoh_port)
    assert len(held) > CONNECTIONS // 2
    try:
        begun = time.monotonic()
        with rig.link(people.of("operator.alice")) as link:
            assert link.wait_for(lambda s: s.health is not None, CONNECT_WITHIN_S) is not None, rig.output("air")
            print(f"beside {len(held)} connections the operator saw the vehicle after {time.monotonic() - begun:.2f} s")
            assert link.start().accepted, rig.output("air")
            view = link.stop()
            assert view.accepted, view.text
            assert view.took_s is not None and view.took_s < STOP_WITHIN_S
    finally:
        for connection in held:
            connection.close()


def test_the_operator_connects_while_silent_connections_are_given_up_and_come_again(
    guarded: tuple[Rig, People],
) -> None:
    rig, people = guarded
    held = idle_connections(rig.zenoh_port)
    time.sleep(5.2)  # as long as an unfinished handshake is waited for: now they fail, one after the other
    held += idle_connections(rig.zenoh_port)
    assert len(held) > CONNECTIONS
    try:
        with rig.link(people.of("operator.alice")) as link:
            assert link.wait_for(lambda s: s.health is not None, CONNECT_WITHIN_S) is not None, rig.output("air")
    finally:
        for connection in held:
            connection.close()


@pytest.mark.parametrize("kind", ["queries", "pings", "payloads", "declarations"])
def test_a_stop_arrives_within_a_second_during_a_flood(guarded: tuple[Rig, People], kind: str) -> None:
    rig, people = guarded
    with rig.link(people.of("operator.alice")) as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 20.0) is not None
        rig.spawn(
            "flood", sys.executable, Path(__file__).parent / "flood.py", kind, rig.endpoint, people.of("observer.bob")
        )
        deadline = time.monotonic() + 20.0
        while "Hz" not in rig.output("flood"):
            assert time.monotonic() < deadline, rig.output("flood")
            time.sleep(0.1)
        assert link.start().accepted, rig.output("air")
        time.sleep(2.0)
        view = link.stop()
        assert view.accepted, view.text
        assert view.took_s is not None
        print(f"{kind}: the stop took {1e3 * view.took_s:.0f} ms; flood {rig.output('flood').split()[-2:]}")
        assert view.took_s < STOP_WITHIN_S
        flood = rig.processes["flood"]
        assert flood.poll() is None, rig.output("flood")


def test_peers_that_break_off_while_they_are_answered_end_nothing(guarded: tuple[Rig, People]) -> None:
    rig, people = guarded
    flood = Path(__file__).parent / "flood.py"
    for kind in ("pings", "queries", "pings"):
        peers = [
            rig.spawn(f"flood-{k}", sys.executable, flood, kind, rig.endpoint, people.of("observer.bob"))
            for k in range(6)
        ]
        time.sleep(3.0)
        for peer in peers:
            assert peer.poll() is None, [rig.output(f"flood-{k}") for k in range(6)]
            peer.kill()
            peer.wait()
    assert rig.processes["air"].poll() is None, rig.output("air")
    with rig.link(people.of("operator.alice")) as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 20.0) is not None, rig.output("air")
