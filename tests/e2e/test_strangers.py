"""Who is not allowed does not fly it: real sessions with real certificates try all that a network lets them try.

The vehicle listens by TLS and admits operator alice and observer bob. Each stranger dials it with whatever Zenoh makes
of its certificate, knows every key, and tries each of them. Nothing may start, stop, blind, steer or silence it.
"""

from __future__ import annotations

import json
import time
import uuid
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from goshawk_ground.keys.names import Role
from goshawk_ground.link import DEFAULT_VEHICLE, GroundLink
from goshawk_ground.link.dial import LinkError
from goshawk_proto import KEYS, key_expression
from goshawk_proto import goshawk_pb2 as pb
from people import People, everybody
from rig import Rig

# Whose certificate ends the handshake, and who gets in and is then refused.
KEPT_OUT = {
    "nobody": "127.0.0.1 was refused",
    "operator.carol": "127.0.0.1 was refused as operator.carol",
    "vehicle.other": "127.0.0.1 was refused as vehicle.other",
    "forged.alice": "127.0.0.1 was refused as operator.alice",
    "operator.mallory": "127.0.0.1 was refused as operator.mallory: it is not admitted",
}


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Rig, People]]:
    """A vehicle that is ready, with its simulator on the unix socket."""
    folder = tmp_path_factory.mktemp("strangers")
    people = everybody(folder)
    rig = Rig(folder=folder, identity=people.of(f"vehicle.{DEFAULT_VEHICLE}"))
    rig.air()
    rig.sim("--seed", "3")
    with rig.link(people.of("operator.alice")) as link:
        ready = link.wait_for(lambda s: s.health is not None and s.health.ready, 60.0)
        assert ready is not None, rig.output("air")
    yield rig, people
    rig.close()


def stranger_config(endpoint: str, folder: Path, ca: Path | None = None) -> zenoh.Config:
    """A client as a stranger writes it: with its certificate if it has one, and no care for whom it talks to. With the
    vehicle's own `ca` it believes the vehicle, whoever made its certificate."""
    tls: dict[str, Any] = {"root_ca_certificate": str(ca or folder / "ca.pem"), "verify_name_on_connect": False}
    if (folder / "key.pem").exists():
        tls |= {
            "enable_mtls": True,
            "connect_certificate": str(folder / "cert.pem"),
            "connect_private_key": str(folder / "key.pem"),
        }
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "connect/timeout_ms": 3000,
        "connect/exit_on_failure": True,
        "scouting/multicast/enabled": False,
        "transport/link/tls": tls,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def key(name: str) -> str:
    return key_expression(name, DEFAULT_VEHICLE)


def image() -> bytes:
    rng = np.random.default_rng(1)
    return pb.Rgbd(
        seq=1, stamp_ns=time.monotonic_ns(), width=160, height=96, hfov_rad=1.5708, vfov_rad=1.0808,
        rgb=rng.integers(0, 255, 46080).astype(np.uint8).tobytes(),
        depth_mm=rng.integers(500, 9000, 15360).astype("<u2").tobytes(),
    ).SerializeToString()  # fmt: skip


class Attempts:
    """Everything that a session can try; what came of it is kept."""

    def __init__(self, session: zenoh.Session, replayed: bytes) -> None:
        self.session = session
        self.replayed = replayed
        self.heard: list[str] = []
        self.asked: list[str] = []
        self.replies: list[str] = []

    def listen(self) -> None:
        """Subscribes to all, offers to answer in the vehicle's place, and shows itself as the vehicle."""
        for pattern in ("**", "goshawk/**", f"goshawk/{DEFAULT_VEHICLE}/**", "*/*/in/*", key("rgbd")):
            self.session.declare_subscriber(
                pattern,
                lambda sample: self.heard.append(str(sample.key_expr)),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        for name in ("cmd_start", "cmd_stop", "ping", "missed", "sim_world"):
            self.session.declare_queryable(
                key(name),
                lambda query: self.asked.append(str(query.key_expr)),
                allowed_origin=zenoh.Locality.REMOTE,
            )
        self.session.liveliness().declare_token(key("alive_air"))

    def speak(self) -> None:
        """Commands, pictures, telemetry and deletions, on every key."""
        start = pb.StartRequest(command_id=str(uuid.uuid4())).SerializeToString()
        stop = pb.StopRequest(command_id=str(uuid.uuid4())).SerializeToString()
        told = pb.MissedRequest().SerializeToString()
        questions = (("cmd_start", start), ("cmd_stop", stop), ("cmd_start", self.replayed), ("missed", told))
        for name, payload in questions:
            for reply in self.session.get(key(name), payload=payload, timeout=1.0):
                if reply.ok is not None:
                    self.replies.append(name)
        for name, row in KEYS.items():
            if row.kind != "pub":
                continue
            for _ in range(20):
                self.session.put(key(name), image() if name == "rgbd" else b"\x08\x01")
            self.session.delete(key(name))
        self.session.delete(f"goshawk/{DEFAULT_VEHICLE}/**")


def flown_by(link: GroundLink) -> tuple[pb.Mode | None, dict[str, int]]:
    """The mode, and what the vehicle counted of its inputs."""
    snap = link.snapshot()
    assert snap.health is not None
    return snap.mode, dict(snap.health.drops)


def refusals(rig: Rig) -> list[str]:
    return [line for line in rig.output("air").splitlines() if "network:" in line]


def told_within(rig: Rig, words: str, seconds: float) -> bool:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if any(words in line for line in refusals(rig)):
            return True
        time.sleep(0.1)
    return False


def test_who_gets_in_without_the_right_changes_nothing_and_is_named(flown: tuple[Rig, People]) -> None:
    rig, people = flown
    who = "observer.bob"
    with rig.link(people.of("operator.alice")) as link:
        before = link.wait_for(lambda s: s.health is not None and s.health.ready, 20.0)
        assert before is not None, rig.output("air")
        refused_before = flown_by(link)[1]["frames_refused"]
        replayed = pb.StartRequest(command_id="once-used").SerializeToString()
        with zenoh.open(stranger_config(rig.endpoint, people.of(who))) as session:
            attempts = Attempts(session, replayed)
            attempts.listen()
            attempts.speak()
            time.sleep(2.5)
            # What the sensors, the vehicle's telemetry and the operator say to each other goes on, and by it alone.
            mode, counts = flown_by(link)
            assert mode == pb.MODE_READY
            assert counts["frames_refused"] == refused_before
            snap = link.snapshot()
            assert snap.health is not None and snap.health.ready and snap.alive
            assert snap.round_trip_s is not None
        # An observer may ask for what it missed, and nothing else.
        assert attempts.replies == ["missed"]
        assert attempts.heard == []
        assert attempts.asked == []
    assert told_within(rig, who, 12.0), refusals(rig)


@pytest.mark.parametrize("who", KEPT_OUT)
def test_who_has_no_good_certificate_never_gets_a_session(flown: tuple[Rig, People], who: str) -> None:
    rig, people = flown
    before, named = len(refusals(rig)), KEPT_OUT[who]
    with ExitStack() as stack:
        try:
            ca = people.of("operator.alice") / "ca.pem"
            session = stack.enter_context(zenoh.open(stranger_config(rig.endpoint, people.of(who), ca)))
        except zenoh.ZError:
            pass
        else:
            # TLS 1.3 lets the client believe that it is in until it hears otherwise.
            time.sleep(1.0)
            assert not list(session.info.routers_zid()) and not list(session.info.peers_zid())
    deadline = time.monotonic() + 12.0
    while time.monotonic() < deadline and not any(named in line for line in refusals(rig)[before:]):
        time.sleep(0.1)
    assert any(named in line for line in refusals(rig)[before:]), refusals(rig)


def test_an_observer_sees_what_an_operator_sees(flown: tuple[Rig, People]) -> None:
    rig, people = flown
    with rig.link(people.of("observer.bob")) as link:
        snap = link.wait_for(lambda s: s.health is not None and s.control is not None and s.plan is not None, 20.0)
        assert snap is not None and snap.alive
        assert link.wait_for(lambda s: s.world is not None, 20.0) is not None
        assert link.wait_for(lambda s: any(event.late for event in s.events), 20.0) is not None, "told what was before"
        assert not link.start(timeout_s=2.0).answered
        assert link.snapshot().mode == pb.MODE_READY


def test_a_ground_believes_no_vehicle_of_another_name(flown: tuple[Rig, People]) -> None:
    rig, people = flown
    with GroundLink(vehicle="other", connect=rig.endpoint, identity=people.of("operator.alice")) as link:
        assert link.wait_for(lambda s: s.health is not None, 3.0) is None
        assert not link.start(timeout_s=1.0).answered


def test_a_ground_whose_certificate_is_refused_says_so(flown: tuple[Rig, People]) -> None:
    rig, people = flown
    for who, words in (
        ("operator.carol", "expired"),
        ("forged.alice", "another owner"),
        ("operator.mallory", "denied"),
    ):
        with rig.link(people.of(who)) as link:
            assert link.wait_for(lambda s: s.health is not None, 2.0) is None
            assert words in link.why_silent(2.0)


def test_without_an_identity_a_ground_says_what_is_missing() -> None:
    with pytest.raises(LinkError, match="--identity"):
        GroundLink(connect="tls/127.0.0.1:7447")


def test_a_link_ends_when_its_certificate_does(flown: tuple[Rig, People]) -> None:
    rig, people = flown
    short = people.make(Role.OPERATOR, "dave", lasts=timedelta(seconds=8))
    with rig.link(short) as link:
        assert link.wait_for(lambda s: s.health is not None, 6.0) is not None, rig.output("air")
        assert link.wait_for(lambda s: not s.linked, 15.0) is not None
        assert not link.start(timeout_s=2.0).answered
        assert link.wait_for(lambda s: s.linked and s.fresh("health", 1.0), 2.0) is None
    with rig.link(people.of("operator.alice")) as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 10.0) is not None


def test_the_operator_starts_and_stops_it(flown: tuple[Rig, People]) -> None:
    """The last of this module: here all that was refused to the others is done."""
    rig, people = flown
    with rig.link(people.of("operator.alice")) as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 20.0) is not None, rig.output("air")
        assert link.start().accepted, rig.output("air")
        assert link.wait_for(lambda s: s.mode == pb.MODE_TAKEOFF, 10.0) is not None
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in {pb.MODE_LANDED, pb.MODE_IDLE, pb.MODE_READY}, 60.0) is not None, (
            rig.output("air")
        )
