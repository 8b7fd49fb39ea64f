"""A vehicle's messages for whoever wants every one of them: a queue that is bounded, and drops the newest when full.

with link.tap() as tap:
    while not done:
        for channel, message in tap.take(0.5): ...
"""

from __future__ import annotations

import queue
from collections.abc import Callable, Iterator
from typing import Self

from google.protobuf.message import Message

WAITING = 4096
"""Messages that may wait: some ten seconds of a vehicle."""

STAMPS = {"plan": "ready_ns"}
"""The field with a message's time, where it is not `stamp_ns`."""


class Tap:
    """Filled by the link's thread, emptied by another. It ends with its ``with``."""

    def __init__(self, end: Callable[[Tap], None], *, late: bool = False) -> None:
        self._end = end
        self.late = late
        """With what is told after a cut, of the time before."""
        self._queue: queue.Queue[tuple[str, Message]] = queue.Queue(WAITING)
        self.dropped = 0
        """Messages that found the queue full."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end(self)

    def put(self, channel: str, message: Message) -> None:
        """Never waits."""
        try:
            self._queue.put_nowait((channel, message))
        except queue.Full:
            self.dropped += 1

    def take(self, wait_s: float) -> Iterator[tuple[str, Message]]:
        """All that waits; if nothing does, the first that comes within ``wait_s``."""
        try:
            yield self._queue.get(timeout=wait_s)
            while True:
                yield self._queue.get_nowait()
        except queue.Empty:
            return


def stamp_ns(channel: str, message: Message) -> int:
    """When it was so, on the vehicle's clock."""
    return int(getattr(message, STAMPS.get(channel, "stamp_ns")))
