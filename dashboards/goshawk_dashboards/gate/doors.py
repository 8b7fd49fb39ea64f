"""Who stands in the door: connections that have not asked anything yet, and pages that are open, both in bounds.

Whoever comes and says nothing waits a few seconds at most, and when the doorway is full the oldest of the address with
the most makes room. So no number of silent connections keeps the operator out: his browser asks within milliseconds.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass

from goshawk_dashboards.gate.headers import address_key

MOST_WAITING = 64
ASK_WITHIN_S = 5.0
"""From the connection to the end of the request's headers, TLS included."""
MOST_OPEN = 48
"""Requests and open pages of one role at once."""
MOST_OPEN_OF_ONE = 16
"""Of those, how many from one address."""


class FullError(Exception):
    """Too many pages are open."""


@dataclass(eq=False, kw_only=True)
class _Visitor:
    """A connection that has not asked anything yet."""

    address: str
    connection: socket.socket
    deadline: asyncio.TimerHandle


class Doors:
    """Takes connections from a listening socket to protocols that ``protocol`` makes."""

    def __init__(
        self, listener: socket.socket, context: ssl.SSLContext | None, protocol: Callable[[], asyncio.Protocol]
    ) -> None:
        self._listener, self._context, self._protocol = listener, context, protocol
        self._waiting: dict[tuple[object, ...], _Visitor] = {}
        self._opening: set[asyncio.Task[None]] = set()
        self._open: Counter[tuple[str, str]] = Counter()

    async def take_in(self) -> None:
        """Runs until it is cancelled."""
        loop = asyncio.get_running_loop()
        try:
            while True:
                try:
                    connection, peer = await loop.sock_accept(self._listener)
                except OSError:  # no more files, or it went away meanwhile
                    self._make_room()
                    await asyncio.sleep(0.05)
                    continue
                while len(self._waiting) >= MOST_WAITING:
                    self._make_room()
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                deadline = loop.call_later(ASK_WITHIN_S, self._turn_away, peer)
                self._waiting[peer] = _Visitor(address=address_key(peer[0]), connection=connection, deadline=deadline)
                task = loop.create_task(self._connect(connection, peer))
                self._opening.add(task)
                task.add_done_callback(self._opening.discard)
        finally:
            for peer in list(self._waiting):
                self._turn_away(peer)
            for task in self._opening:
                task.cancel()

    async def _connect(self, connection: socket.socket, peer: tuple[object, ...]) -> None:
        secure = {} if self._context is None else {"ssl_handshake_timeout": ASK_WITHIN_S, "ssl_shutdown_timeout": 1.0}
        try:
            await asyncio.get_running_loop().connect_accepted_socket(
                self._protocol, connection, ssl=self._context, **secure
            )
        except (OSError, asyncio.CancelledError):  # no TLS, or gone
            self._turn_away(peer)
            connection.close()

    def asked(self, peer: tuple[object, ...]) -> None:
        """A whole request came over the connection from ``peer``: it waits no more."""
        visitor = self._waiting.pop(peer, None)
        if visitor is not None:
            visitor.deadline.cancel()

    @contextmanager
    def opened(self, role: str, address: str) -> Generator[None]:
        """Counts a page as open. Raises FullError."""
        of_role = sum(count for (other, _), count in self._open.items() if other == role)
        if of_role >= MOST_OPEN or self._open[role, address] >= MOST_OPEN_OF_ONE:
            raise FullError
        self._open[role, address] += 1
        try:
            yield
        finally:
            self._open[role, address] -= 1
            self._open += Counter()  # drops the zeros

    def _make_room(self) -> None:
        if not self._waiting:
            return
        most, _ = Counter(visitor.address for visitor in self._waiting.values()).most_common(1)[0]
        self._turn_away(next(peer for peer, visitor in self._waiting.items() if visitor.address == most))

    def _turn_away(self, peer: tuple[object, ...]) -> None:
        visitor = self._waiting.pop(peer, None)
        if visitor is None:
            return
        visitor.deadline.cancel()
        with contextlib.suppress(OSError):  # the transport sees the end and closes
            visitor.connection.shutdown(socket.SHUT_RDWR)
