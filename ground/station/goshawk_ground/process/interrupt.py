"""Ctrl-C, SIGTERM and a closed terminal set an event, which whoever works looks at.

They raise nothing: an exception would come up wherever the interpreter happens to be, also in a library that swallows
it, or in the collection of garbage, which prints it and goes on.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Generator
from contextlib import contextmanager


@contextmanager
def interrupted() -> Generator[threading.Event]:
    """An event that the three set, in place of what they do otherwise. Under `nohup` a closed terminal sets nothing."""
    done = threading.Event()
    ends = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        ends.append(signal.SIGHUP)

    def end(*_: object) -> None:
        done.set()

    before = {s: signal.signal(s, end) for s in ends}
    try:
        yield done
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def until_interrupted() -> Generator[None]:
    """What is said in it can be answered by any of them at once: its end waits for either."""
    with interrupted() as done:
        yield
        while not done.wait(0.5):
            pass
