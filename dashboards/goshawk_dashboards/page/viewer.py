"""Who looks: one browser, or, in tests of what is drawn, a server that stands for all."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from typing import Generic, TypeVar
from weakref import WeakSet

import viser

Viewer = viser.ClientHandle | viser.ViserServer
"""Both have a GUI and a scene; what a client's hold is seen by that browser alone."""

View = TypeVar("View")

_log = logging.getLogger(__name__)


class Guard:
    """Keeps the one thread that draws alive: whatever fails for one viewer or vehicle is left out for it alone."""

    def __init__(self) -> None:
        self._failed: WeakSet[object] = WeakSet()

    @contextmanager
    def over(self, one: object) -> Generator[None]:
        """Around what is done for ``one``, whose first failure alone is logged."""
        try:
            yield
        except Exception:
            if one not in self._failed:
                self._failed.add(one)
                _log.exception("a %s failed; it is left out wherever it does", type(one).__name__)


class Views(Generic[View]):
    """What each browser that is connected to a server sees, for the one thread that draws."""

    def __init__(self, server: viser.ViserServer, make: Callable[[viser.ClientHandle], View]) -> None:
        """``make`` is called on that thread, for a browser that has come."""
        self._server = server
        self._make = make
        self._guard = Guard()
        self._came: SimpleQueue[viser.ClientHandle] = SimpleQueue()
        self._views: dict[int, View] = {}
        # A browser may leave while it is drawn for; that it then gets nothing is no news to anyone.
        warnings.filterwarnings("ignore", message="Queued a .* on a closed connection", category=UserWarning)
        server.on_client_connect(lambda client: self._came.put(client))

    @property
    def all(self) -> tuple[View, ...]:
        """The oldest first; safe from any thread."""
        return tuple(self._views.values())

    def settle(self) -> tuple[View, ...]:
        """Makes a view for everyone who came, and drops those of who left."""
        came: dict[int, View] = {}
        try:
            while True:
                client = self._came.get_nowait()
                with self._guard.over(client):
                    came[client.client_id] = self._make(client)
        except Empty:
            pass
        here = self._server.get_clients()
        self._views = {k: view for k, view in (self._views | came).items() if k in here}
        return self.all
