"""Asks the vehicle for what was missed, once it is heard again: page by page, and never while a Stop is pending."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Protocol

from google.protobuf.message import Message
from goshawk_proto import goshawk_pb2 as pb

from goshawk_ground.link.missed import Missed

PERIOD_S = 0.5
"""What is missing is looked for so often."""
PAGE_TIMEOUT_S, PAGE_TRIES = 3.0, 5
"""How long a page is waited for, and how often it is asked for in vain."""


class Asker(Protocol):
    """What it needs of a link."""

    def ask(self, key: str, request: Message | None, timeout_s: float) -> Iterator[Message]:
        """The well-formed replies to one query."""
        ...

    def may_ask(self) -> bool:
        """Whether nothing more urgent is under way."""
        ...


class CatchUp:
    """One vehicle's. ``heard`` is for the link's thread, ``run`` is a thread of its own."""

    def __init__(self, link: Asker, told: Callable[[str, Message], None]) -> None:
        """``told`` takes each channel and message that was missed."""
        self._link, self._told = link, told
        self._lock = threading.Lock()
        self._missed = Missed()

    def heard(self, message: Message) -> None:
        """A well-formed message came as it should."""
        with self._lock:
            if isinstance(message, pb.Event):
                self._missed.heard_event(message.seq)
            elif isinstance(message, pb.Health):
                self._missed.heard_health(message)
            elif isinstance(message, pb.Control):
                self._missed.heard_step(message.stamp_ns)
            elif isinstance(message, pb.Target):
                self._missed.heard_target(message.stamp_ns)

    def run(self, closing: threading.Event) -> None:
        """Until ``closing``."""
        while not closing.wait(PERIOD_S):
            tries = 0
            while tries < PAGE_TRIES and not closing.is_set() and self._link.may_ask():
                with self._lock:
                    request = self._missed.request()
                if request is None:
                    break
                page = next(self._link.ask("missed", request, PAGE_TIMEOUT_S), None)
                if isinstance(page, pb.Missed) and self._take(request, page):
                    tries = 0
                else:
                    tries += 1
                    closing.wait(PERIOD_S)
            if tries == PAGE_TRIES:
                with self._lock:
                    self._missed.give_up()

    def _take(self, request: pb.MissedRequest, page: pb.Missed) -> bool:
        with self._lock:
            good = self._missed.take(request, page)
        if good:
            # Targets before the steps that they are drawn with.
            told = {"event": page.events, "target": page.targets, "control": page.controls, "health": page.healths}
            for channel, messages in told.items():
                for message in messages:
                    self._told(channel, message)
        return good
