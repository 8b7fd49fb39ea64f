"""A radio link between ground and vehicle that can be slow, lossy or cut: a TCP relay.

To a TCP stream a lost segment is a pause, of itself and of all behind it, until it is sent again; so that is what loss
is here, with TCP's own times: 0.2 s, doubled each time that the segment is lost again. A cut holds everything back and
closes nothing, as a radio does.
"""

from __future__ import annotations

import contextlib
import random
import socket
import threading
import time
from collections import deque
from dataclasses import dataclass, field

SEGMENT = 1448
"""Bytes of one TCP segment on Ethernet."""
RETRANSMISSION_S = 0.2
"""Least time after which TCP sends again."""
WINDOW = 4 * SEGMENT
"""What a lossy link lets be under way. More would be a queue of our own, which the vehicle cannot see."""
RATE = 250_000
"""What else, bytes for each second of delay."""


@dataclass(kw_only=True)
class WeakLink:
    """Listens on ``port`` and relays to ``to_port``, both on loopback."""

    to_port: int
    delay_s: float = 0.0
    """One way."""
    loss: float = 0.0
    """Probability that a segment is lost, each time it is sent."""
    seed: int = 1
    port: int = field(init=False)
    _there: threading.Event = field(default_factory=threading.Event)
    _back: threading.Event = field(default_factory=threading.Event)
    _closing: threading.Event = field(default_factory=threading.Event)
    _sockets: list[socket.socket] = field(default_factory=list[socket.socket])

    def __post_init__(self) -> None:
        self.mend()
        self._random = random.Random(self.seed)
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, WINDOW)
        self.port = self._server.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    @property
    def endpoint(self) -> str:
        return f"tcp/127.0.0.1:{self.port}"

    def cut(self) -> None:
        self._there.clear()
        self.cut_back()

    def cut_back(self) -> None:
        """Holds back only what comes from ``to_port``."""
        self._back.clear()

    def mend(self) -> None:
        self._there.set()
        self._back.set()

    def close(self) -> None:
        self._closing.set()
        self.mend()
        for each in [self._server, *self._sockets]:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def __enter__(self) -> WeakLink:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                near, _ = self._server.accept()
                self._there.wait()
                far = socket.socket()
                far.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, WINDOW)
                far.connect(("127.0.0.1", self.to_port))
            except OSError:
                continue
            self._sockets += [near, far]
            for source, sink, up in ((near, far, self._there), (far, near, self._back)):
                source.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=self._relay, args=(source, sink, up), daemon=True).start()

    def _relay(self, source: socket.socket, sink: socket.socket, up: threading.Event) -> None:
        """Segments are under way for a while, one behind the other; no more of them than fit the delay."""
        under_way: deque[tuple[float, bytes]] = deque()
        arrived = threading.Condition()

        def deliver() -> None:
            while True:
                with arrived:
                    arrived.wait_for(lambda: under_way)
                    due_s, segment = under_way.popleft()
                    arrived.notify()
                time.sleep(max(0.0, due_s - time.monotonic()) + self._lost_s())
                up.wait()
                try:
                    sink.sendall(segment)
                except OSError:
                    return
                if not segment:
                    with contextlib.suppress(OSError):
                        sink.shutdown(socket.SHUT_WR)
                    return

        threading.Thread(target=deliver, daemon=True).start()
        most = WINDOW + int(self.delay_s * RATE)
        segment = b" "
        while segment:
            try:
                segment = source.recv(SEGMENT)
            except OSError:
                segment = b""
            with arrived:
                arrived.wait_for(lambda: sum(len(each) for _, each in under_way) <= most)
                under_way.append((time.monotonic() + self.delay_s, segment))
                arrived.notify()

    def _lost_s(self) -> float:
        """For how long a segment is sent again and again."""
        waited_s, pause_s = 0.0, RETRANSMISSION_S
        while self._random.random() < self.loss:
            waited_s += pause_s
            pause_s *= 2
        return waited_s
