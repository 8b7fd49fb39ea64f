"""Keeps a camera open: one that is unplugged is waited for and opened again, until a person ends it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator

from goshawk_sensors.cameras.source import Frame, Source
from goshawk_sensors.setup.errors import CameraError, EndOfRecordingError, NoCameraError, RecordingError

AGAIN_S, SAY_S = 1.0, 10.0
"""How often a camera that is gone is looked for, and how often a person is told that it still is."""

Opening = Callable[[], Source]
Say = Callable[[str], None]


def begun(opening: Opening, ending: threading.Event, say: Say, *, wait: bool) -> Source | None:
    """The open camera; None: ended before it was there. Raises CameraError, with ``wait`` RecordingError alone."""
    return _waited(opening, ending, say) if wait else opening()


def frames(
    source: Source | None,
    opening: Opening,
    ending: threading.Event,
    say: Say,
    *,
    loop: bool = False,
    again: bool = True,
    until_s: float = math.inf,
) -> Iterator[tuple[Source, Frame]]:
    """Each pair, and the source that it is of, until ``ending`` is set, a recording has been played once, or it is
    ``until_s`` by the monotonic clock.

    A source that is gone is opened ``again``, or raises NoCameraError; what is open at the end is closed.
    """
    try:
        while source is not None and not ending.is_set() and time.monotonic() < until_s:
            try:
                frame = source.read()
            except EndOfRecordingError:
                if not loop:
                    return
                source.close()
                source = opening()
            except NoCameraError as error:
                if not again:
                    raise
                say(f"{error}: looking for it")
                source.close()
                source = _waited(opening, ending, say, until_s)
            else:
                if frame is not None:
                    yield source, frame
    finally:
        if source is not None:
            source.close()


def _waited(opening: Opening, ending: threading.Event, say: Say, until_s: float = math.inf) -> Source | None:
    """The camera, however long it takes; None: ended before it came."""
    say_at_s = time.monotonic()
    while not ending.is_set() and time.monotonic() < until_s:
        try:
            source = opening()
        except RecordingError:
            raise  # no camera that comes mends that
        except CameraError as error:  # not only NoCameraError: one that has just been plugged in may not answer yet
            if time.monotonic() >= say_at_s:
                say(f"{error}; still looking")
                say_at_s = time.monotonic() + SAY_S
            ending.wait(AGAIN_S)
        else:
            say(f"{source.name} is there")
            return source
    return None
