"""The ground's Foxglove WebSocket, met by a client that speaks their protocol and knows none of our code."""

from __future__ import annotations

import base64
import json
import socket
import struct
import time
from collections.abc import Callable, Iterator, Set
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Self

import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import Message
from goshawk_ground.cli import app
from goshawk_ground.link import GroundLink
from goshawk_ground.pages.tools import foxglove_feeds
from typer.testing import CliRunner
from websockets.sync.client import connect
from websockets.typing import Subprotocol

Fakes = Callable[..., Any]
HEAD = struct.Struct("<BIQ")
"""Opcode, subscription, time."""
TELEMETRY = {f"/tel/{name}" for name in ("plan", "map", "control", "target", "health", "event", "preview")}
SCENE = {f"/scene/{name}" for name in ("vehicle", "plan", "target", "truth", "path")}
TOPICS = {*TELEMETRY, *SCENE, "/sim/truth", "/tf", "/vehicle/pose", "/camera/image", "/remembered", "/log"}


@pytest.fixture
def port() -> int:
    """One that is free now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def reader(channel: dict[str, Any]) -> Callable[[bytes], Message]:
    """How to read a channel's messages, by nothing but the schema that the server sent."""
    files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
    return kind.FromString


class Viewer:
    """Subscribes to all that is advertised, and keeps the newest message of each topic."""

    def __init__(self, port: int) -> None:
        self.client = connect(f"ws://127.0.0.1:{port}", subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None)
        self.newest: dict[str, Any] = {}
        self.topics: dict[int, str] = {}
        self._readers: dict[int, Callable[[bytes], Message]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()

    def until(self, topics: Set[str]) -> dict[str, Any]:
        """Listens until each of these topics has come."""
        deadline = time.monotonic() + 60.0
        while missing := topics - self.newest.keys():
            try:
                self._take(self.client.recv(timeout=max(deadline - time.monotonic(), 0.01)))
            except TimeoutError:
                raise AssertionError(f"never came: {missing}") from None
        return self.newest

    def _take(self, frame: str | bytes) -> None:
        if isinstance(frame, bytes):
            opcode, subscription, at_ns = HEAD.unpack_from(frame)
            assert opcode == 1 and at_ns > 0
            self.newest[self.topics[subscription]] = self._readers[subscription](frame[HEAD.size :])
            return
        told: dict[str, Any] = json.loads(frame)
        if told["op"] != "advertise":
            return
        for channel in told["channels"]:
            assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
            number = channel["id"]
            self.topics[number], self._readers[number] = channel["topic"], reader(channel)
            wanted = [{"id": number, "channelId": number}]
            self.client.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


@dataclass(frozen=True, kw_only=True)
class Served:
    """A vehicle that is ready, and the port at which it is served."""

    link: GroundLink
    port: int


@pytest.fixture
def served(fake_vehicle: Fakes, port: int) -> Iterator[Served]:
    """It, for a test."""
    with ExitStack() as stack:
        link = stack.enter_context(GroundLink(connect=fake_vehicle().endpoint))
        for feed in foxglove_feeds([link], port).values():
            stack.enter_context(feed)
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 30.0) is not None
        yield Served(link=link, port=port)


def test_a_viewer_gets_a_message_of_every_channel_that_is_advertised(served: Served) -> None:
    with Viewer(served.port) as viewer:
        viewer.until({"/tel/health"})
        # What happens once is not lost to whoever watches already.
        assert served.link.start().accepted
        found = viewer.until(TOPICS)
        assert set(viewer.topics.values()) == TOPICS
    assert found["/tel/health"].vehicle == "goshawk"
    assert found["/tf"].child_frame_id == "body"
    assert found["/tf"].translation.x == pytest.approx(found["/tel/control"].pos_world.x, abs=2.0)
    assert found["/camera/image"].format == "jpeg" and found["/camera/image"].data[:2] == b"\xff\xd8"
    assert [entity.id for entity in found["/scene/plan"].entities] == ["candidates", "chosen"]
    assert found["/scene/path"].entities[0].id == "path"


def test_a_viewer_who_comes_late_gets_what_stands(served: Served) -> None:
    for _ in range(2):
        with Viewer(served.port) as viewer:
            viewer.until({"/scene/vehicle", "/scene/path"})


def test_a_viewer_may_send_nothing_and_only_this_computer_is_served(served: Served) -> None:
    with Viewer(served.port) as viewer:
        told = json.loads(viewer.client.recv(timeout=10.0))
    assert (told["op"], told["capabilities"]) == ("serverInfo", [])
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.2", served.port), timeout=5.0)


def test_a_port_that_is_taken_is_one_line_and_nothing_is_served(free_endpoint: str, port: int) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", port))
        taken.listen()
        done = CliRunner().invoke(app, ["ground", "--connect", free_endpoint, "--foxglove", str(port)])
    assert done.exit_code == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert f"port {port} cannot be used for Foxglove" in done.stderr


def test_two_vehicles_have_a_port_each(free_endpoint: str, port: int) -> None:
    with (
        GroundLink(vehicle="alpha", connect=free_endpoint) as alpha,
        GroundLink(vehicle="bravo", connect=free_endpoint) as bravo,
        ExitStack() as stack,
    ):
        feeds = foxglove_feeds([alpha, bravo], port)
        for feed in feeds.values():
            stack.enter_context(feed)
        names = []
        for url in feeds:
            with connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
                names.append(json.loads(client.recv(timeout=10.0))["name"])
    assert list(feeds) == [f"ws://127.0.0.1:{port}", f"ws://127.0.0.1:{port + 1}"]
    assert names == ["Goshawk: alpha", "Goshawk: bravo"]
