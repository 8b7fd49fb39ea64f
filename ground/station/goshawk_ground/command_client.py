"""Commands to the vehicle: asks until it is answered or time is up, and says in a line what became of it."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any, Protocol

from google.protobuf.message import Message
from goshawk_dashboards import decode
from goshawk_dashboards.snapshot import CommandView
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

    def ask(self, key: str, request: Message | None, timeout_s: float) -> Iterator[Message]:
        """The well-formed replies to one query."""
        ...

    def why_silent(self, waited_s: float) -> str:
        """One line: what to check when no answer came."""
        ...


class CommandClient:
    """Sends start and stop. Each view, the pending one first, goes to ``told``."""

    def __init__(self, link: Asker, told: Callable[[CommandView], None]) -> None:
        self._link = link
        self._told = told

    def start(self, profile: str, timeout_s: float) -> CommandView:
        """Asks for the flight to begin; ``profile`` empty: the vehicle's default."""
        request = goshawk_pb2.StartRequest(command_id=str(uuid.uuid4()), profile=profile)
        return self._command("start", request, timeout_s)

    def stop(self, timeout_s: float) -> CommandView:
        """Asks for the flight to end."""
        return self._command("stop", goshawk_pb2.StopRequest(command_id=str(uuid.uuid4())), timeout_s)

    def _command(
        self, verb: str, request: goshawk_pb2.StartRequest | goshawk_pb2.StopRequest, timeout_s: float
    ) -> CommandView:
        at_s = time.monotonic()
        view = CommandView(
            verb=verb,
            command_id=request.command_id,
            answered=False,
            accepted=False,
            text="sent, no reply yet",
            mode=None,
            pending=True,
            at_s=at_s,
        )
        self._told(view)
        reply = self._reply(f"cmd_{verb}", request, timeout_s)
        if reply is None:
            view = replace(view, pending=False, text=self._link.why_silent(timeout_s))
        else:
            view = replace(
                view,
                pending=False,
                answered=True,
                accepted=reply.accepted,
                text=_one_line(reply.reason) or ("accepted" if reply.accepted else "refused without a reason"),
                mode=decode.mode_name(reply.mode),
                took_s=time.monotonic() - at_s,
            )
        self._told(view)
        return view

    def _reply(self, key: str, request: Any, timeout_s: float) -> goshawk_pb2.CommandReply | None:
        """Asks until it is answered or time is up. The id stays the same, so the vehicle acts once at most."""
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0.0 and not self._link.closing:
            if not self._link.linked:
                time.sleep(min(0.05, left_s))
                continue
            # One attempt is short, so that a request lost on a weak link is soon sent again.
            for reply in self._link.ask(key, request, min(left_s, max(0.5, timeout_s / 3.0))):
                if isinstance(reply, goshawk_pb2.CommandReply) and reply.command_id == request.command_id:
                    return reply
            time.sleep(min(0.1, max(0.0, deadline - time.monotonic())))
        return None


def _one_line(text: object) -> str:
    return " ".join(str(text).split())
