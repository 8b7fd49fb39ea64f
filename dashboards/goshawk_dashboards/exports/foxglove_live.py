"""A vehicle in flight for Foxglove and Lichtblick: their WebSocket, with the channels of the export.

Their protocol knows no login, so the server listens to this computer only, and takes nothing from whoever connects.
"""

from __future__ import annotations

import foxglove
from google.protobuf.message import Message
from goshawk_proto import KEYS
from mcap_protobuf.schema import build_file_descriptor_set

from goshawk_dashboards.exports.foxglove import TOPICS, Scene
from goshawk_dashboards.exports.source import Record

HOST = "127.0.0.1"
STANDING_NS = 1_000_000_000
"""What stands for the whole flight is sent again so often, for whoever came later."""
PATH_POINTS = 2000
"""The last 200 m of the flown path."""
SCENE = {t: kind for t, kind in TOPICS.items() if t not in ("/tf_static", "/camera/depth", "/camera/calibration")}
"""Telemetry has no depth, and does not say where the camera is."""
HEARD = frozenset({"observer"})
"""Who takes telemetry may see it here too."""
WAITING = 256
"""Messages that may wait for one slow viewer; then the oldest go."""


class FoxgloveServer:
    """Serves one vehicle. For one thread."""

    def __init__(self, name: str, port: int) -> None:
        """Raises OSError, one line, if the port is taken."""
        self._context = foxglove.Context()
        self._scene = Scene(PATH_POINTS)
        self._stood_ns: int | None = None
        try:
            self._server = foxglove.start_server(
                name=name, host=HOST, port=port, context=self._context, message_backlog_size=WAITING
            )
        except RuntimeError as error:
            raise OSError(f"port {port} cannot be used for Foxglove ({error}): give another --foxglove") from error
        self.url = f"ws://{HOST}:{port}"
        # All at once: a channel that began with its first message would have lost it to whoever watches.
        ours = {f"/{row.suffix}": row.message for row in KEYS.values() if row.taken_by >= HEARD and row.message}
        self._channels = {topic: self._channel(topic, kind) for topic, kind in {**ours, **SCENE}.items()}

    def take(self, record: Record) -> None:
        """Sends a message, and what it changes in the scene."""
        self._send(f"/{record.topic}", record.message, record.log_ns)
        for topic, message in self._scene.of(record):
            self._send(topic, message, record.log_ns)
        if self._stood_ns is None or not 0 <= record.log_ns - self._stood_ns < STANDING_NS:
            self._stood_ns = record.log_ns
            for topic, message in self._scene.standing(record.log_ns):
                self._send(topic, message, record.log_ns)

    def close(self) -> None:
        """Says goodbye to whoever watches."""
        self._server.stop()

    def _send(self, topic: str, message: Message, log_ns: int) -> None:
        self._channels[topic].log(message.SerializeToString(), log_time=log_ns)

    def _channel(self, topic: str, kind: type[Message]) -> foxglove.Channel:
        data = build_file_descriptor_set(kind).SerializeToString()
        schema = foxglove.Schema(name=kind.DESCRIPTOR.full_name, encoding="protobuf", data=data)
        return foxglove.Channel(topic, schema=schema, message_encoding="protobuf", context=self._context)
