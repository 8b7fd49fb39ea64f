"""A ROS 2 world without ROS: a Zenoh router as rmw_zenohd is one, and a node by rosbags' own CDR.

Nothing here is ours: keys, attachments and tokens are put together from what rmw_zenoh documents. `tests/data` has
those of a real one.
"""

from __future__ import annotations

import hashlib
import json
import struct
import threading
import time
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from typing import Any

import zenoh
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
TYPES: dict[str, Any] = dict(STORE.types)
GID = bytes(range(16))
HUMBLE = "TypeHashNotSupported"


def new(kind: str, **fields: Any) -> Any:
    """A message: `new("geometry_msgs/msg/Point", x=1.0, y=2.0, z=3.0)`."""
    return TYPES[kind](**fields)


def header(stamp_ns: int, frame: str = "camera") -> Any:
    stamp = new("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return new("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def mangled(kind: str) -> str:
    package, _, name = kind.split("/")
    return f"{package}::msg::dds_::{name}_"


@cache
def own_hash(kind: str) -> str:
    """Of a type; kept, for it takes as long as to write a message."""
    return STORE.hash_rihs01(kind)


def listening(port: int, mode: str) -> zenoh.Session:
    """A session that listens on a port of this host and looks for nobody."""
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "listen/endpoints": [f"tcp/127.0.0.1:{port}"],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


@dataclass(frozen=True, kw_only=True)
class Heard:
    """One message and what came with it."""

    key: str
    message: Any
    attachment: bytes


def dialled(endpoint: str) -> zenoh.Session:
    """A client's session by the router there."""
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class RosPeer:
    """One node of ROS 2: with its router, which listens on the port, or by another's at that address.

    Close it when done.
    """

    def __init__(self, router: int | str, domain: int = 0) -> None:
        self.endpoint = router if isinstance(router, str) else f"tcp/127.0.0.1:{router}"
        self.domain = domain
        self.session = dialled(router) if isinstance(router, str) else listening(router, "router")
        self.tokens: set[str] = set()
        self.heard: dict[str, list[Heard]] = defaultdict(list)
        self._lock = threading.Lock()
        self._sequence: dict[str, int] = defaultdict(int)
        self.session.liveliness().declare_subscriber(f"@ros2_lv/{domain}/**", self._token, history=True)

    def _token(self, sample: zenoh.Sample) -> None:
        with self._lock:
            if sample.kind == zenoh.SampleKind.PUT:
                self.tokens.add(str(sample.key_expr))
            else:
                self.tokens.discard(str(sample.key_expr))

    def key(self, topic: str, kind: str, type_hash: str | None = None) -> str:
        found = type_hash or own_hash(kind)
        return f"{self.domain}/{topic.strip('/')}/{mangled(kind)}/{found}"

    def publish(
        self, topic: str, kind: str, message: Any, *, type_hash: str | None = None, little: bool = True
    ) -> None:
        data = STORE.serialize_cdr(message, kind, little_endian=little)
        self.put(topic, kind, bytes(data), type_hash=type_hash)

    def put(self, topic: str, kind: str, data: bytes, *, type_hash: str | None = None) -> None:
        """Bytes that may be no message at all."""
        self._put(self.key(topic, kind, type_hash), data)

    def _put(self, key: str, data: bytes) -> None:
        self._sequence[key] += 1
        attachment = struct.pack("<qqB16s", self._sequence[key], time.time_ns(), len(GID), GID)
        self.session.put(key, data, attachment=attachment)

    def publish_buffered(self, topic: str, kind: str, message: Any) -> None:
        """As a node of Lyrical publishes what holds bytes: not on the topic's key, but for each subscription it sees.

        One key serves all that take it from memory. Every other has one of its own, which here is some number of its.
        """
        key, data = self.key(topic, kind), bytes(STORE.serialize_cdr(message, kind))
        of_topic = f"/%{topic.strip('/').replace('/', '%')}/{mangled(kind)}/"
        with self._lock:
            seen = [token for token in self.tokens if "/MS/" in token and of_topic in token]
        own = [token for token in seen if not token.endswith("/backends:cpu:")]
        ends = [f"_buf/{hashlib.sha256(token.encode()).hexdigest()[:32]}" for token in own]
        for end in ends + ["_buf_cpu"] * (len(own) < len(seen)):
            self._put(f"{key}/{end}", data)

    def listen(self, topic: str, kind: str) -> None:
        """Reads what comes on a topic by rosbags, as a node of this release subscribes to it."""

        def take(sample: zenoh.Sample) -> None:
            message = STORE.deserialize_cdr(sample.payload.to_bytes(), kind)
            attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
            with self._lock:
                self.heard[topic].append(Heard(key=str(sample.key_expr), message=message, attachment=attachment))

        self.session.declare_subscriber(self.key(topic, kind), take)

    def close(self) -> None:
        self.session.close()  # pyright: ignore[reportUnknownMemberType]


def until(true: Any, what: str, seconds: float = 20.0) -> Any:
    """The first value that is true of those that a question gives."""
    end = time.monotonic() + seconds
    while not (found := true()):
        assert time.monotonic() < end, what
        time.sleep(0.02)
    return found
