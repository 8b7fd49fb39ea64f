"""A node of a real Ray cluster that dies in the middle of its work."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Any


@contextmanager
def losing_a_node(cluster: Any, done: Callable[[], int]) -> Generator[list[int]]:
    """One of the two nodes dies once some work is done. Gives how much was done then, once it has."""
    dies = cluster.list_all_nodes()[-1]
    then: list[int] = []
    ended = threading.Event()

    def kill() -> None:
        while not ended.wait(0.02):
            if finished := done():
                then.append(finished)
                cluster.remove_node(dies, allow_graceful=False)
                return

    killer = threading.Thread(target=kill, daemon=True)
    killer.start()
    try:
        yield then
    finally:
        ended.set()
        killer.join(60.0)
