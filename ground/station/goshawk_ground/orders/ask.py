"""Start, and what it shares with Stop: a question is put to the vehicle until it is answered, under one id."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Protocol

from google.protobuf.message import Message
from goshawk_dashboards.state.views import CommandView
from goshawk_proto import goshawk_pb2


class Asker(Protocol):
    """What commands need of a link."""

    @property
    def linked(self) -> bool:
        """Whether a transport to the vehicle is open."""
        ...

    @property
    def closing(self) -> bool:
        """Whether the link is being given up."""
        ...

    @property
    def stops_pressed(self) -> int:
        """How often a Stop was pressed."""
        ...

    @property
    def told_stops(self) -> tuple[int, int]:
        """By the newest heartbeat: which process of the vehicle it is, 0 if that is not told, and how many stops were
        asked of it."""
        ...

    def ask(self, key: str, request: Message | None, timeout_s: float) -> Iterator[Message]:
        """The well-formed replies to one query."""
        ...

    def why_silent(self, waited_s: float) -> str:
        """One line: what to check when no answer came."""
        ...

    def refuses_start(self, timeout_s: float) -> str:
        """One line: why this ground must not start the vehicle, as soon as a heartbeat tells; empty: nothing is known
        against it."""
        ...


class Starter:
    """Sends Start, until it is answered or a Stop is pressed. Each view, the pending one first, goes to ``told``."""

    def __init__(self, link: Asker, told: Callable[[CommandView], None]) -> None:
        self._link = link
        self._told = told

    def start(self, profile: str, timeout_s: float, given_up: threading.Event) -> CommandView:
        """Asks for the flight to begin; ``profile`` empty: the vehicle's default. Waits for the answer, and asks no
        more once ``given_up`` is set."""
        request = goshawk_pb2.StartRequest(command_id=str(uuid.uuid4()), profile=profile)
        stops = self._link.stops_pressed
        view = sent("start", request.command_id, time.monotonic())
        self._told(view)
        why_not = self._link.refuses_start(timeout_s)
        # From here on, a Stop of whomever overtakes it: the vehicle knows by these.
        request.session, request.stops = self._link.told_stops
        if why_not:
            view = replace(view, pending=False, refused_here=True, text=why_not)
        elif (
            reply := self._reply(request, stops, timeout_s - (time.monotonic() - (view.at_s or 0.0)), given_up)
        ) is not None:
            view = answered(view, reply)
        elif given_up.is_set():
            text = "taken back before the vehicle answered; it may have heard it before"
            view = replace(view, pending=False, cancelled=True, text=text)
        elif self._link.stops_pressed != stops:
            view = replace(view, pending=False, refused_here=True, text="not asked any more: a Stop was pressed since")
        else:
            view = replace(view, pending=False, text=self._link.why_silent(timeout_s))
        self._told(view)
        return view

    def _reply(
        self, request: goshawk_pb2.StartRequest, stops: int, timeout_s: float, given_up: threading.Event
    ) -> goshawk_pb2.CommandReply | None:
        """Asks until it is answered, time is up, or a Stop is pressed beyond the first ``stops``: asked after that, a
        Start whose question was lost would begin the flight that the Stop was for.

        The id stays the same, so the vehicle acts once at most.
        """
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0.0 and not self._link.closing:
            if self._link.stops_pressed != stops or given_up.is_set():
                return None
            if not self._link.linked:
                time.sleep(min(0.05, left_s))
                continue
            # One attempt is short, so that a request lost on a weak link is soon sent again.
            reply = ask_once(self._link, "cmd_start", request, min(left_s, max(0.5, timeout_s / 3.0)))
            if reply is not None:
                return reply
            time.sleep(min(0.1, max(0.0, deadline - time.monotonic())))
        return None


def ask_once(link: Asker, key: str, request: Any, timeout_s: float) -> goshawk_pb2.CommandReply | None:
    """The vehicle's reply to one question; None: none came in time."""
    for reply in link.ask(key, request, timeout_s):
        if isinstance(reply, goshawk_pb2.CommandReply) and reply.command_id == request.command_id:
            return reply
    return None


def sent(verb: str, command_id: str, at_s: float) -> CommandView:
    """A command without an answer yet."""
    return CommandView(
        verb=verb,
        command_id=command_id,
        answered=False,
        accepted=False,
        text="sent, no reply yet",
        mode=None,
        pending=True,
        at_s=at_s,
    )


def answered(view: CommandView, reply: goshawk_pb2.CommandReply) -> CommandView:
    """The same with the vehicle's answer."""
    return replace(
        view,
        pending=False,
        answered=True,
        accepted=reply.accepted,
        text=_one_line(reply.reason) or ("accepted" if reply.accepted else "refused without a reason"),
        mode=reply.mode,
        took_s=time.monotonic() - (view.at_s or 0.0),
    )


def _one_line(text: object) -> str:
    return " ".join(str(text).split())
