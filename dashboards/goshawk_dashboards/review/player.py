"""Where a review stands on its timeline and how it moves. Knows no clock: the caller says how much time passed."""

from __future__ import annotations

import threading

import numpy as np

from goshawk_dashboards.state.views import Array

SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
SCRUB_HOLD_S = 0.4
"""While the viewer drags the timeline, playing waits for this long after the last movement."""


class Player:
    """A position within ``begin_s`` .. ``end_s``. Safe from any thread."""

    def __init__(self, end_s: float, wake: threading.Event | None = None, *, begin_s: float = 0.0) -> None:
        """It stands at 0. ``wake`` is set with ``moved``: several players can have one for whoever waits for any of
        them."""
        self.begin_s, self.end_s = begin_s, end_s
        self.moved = threading.Event()
        """Set by everything but the passing of time: there is something new to show at once."""
        self._wake = wake
        self._lock = threading.Lock()
        self._time_s = 0.0
        self._playing = False
        self._speed = 1.0
        self._hold_s = 0.0

    @property
    def time_s(self) -> float:
        """The instant that is shown."""
        return self._time_s

    @property
    def playing(self) -> bool:
        """Whether time passes."""
        return self._playing

    def touch(self) -> None:
        """There is something new to show."""
        self.moved.set()
        if self._wake is not None:
            self._wake.set()

    def advance(self, elapsed_s: float) -> None:
        """Lets time pass; at the end it stops."""
        with self._lock:
            held_s = min(self._hold_s, elapsed_s)
            self._hold_s -= held_s
            if not self._playing:
                return
            self._time_s += self._speed * (elapsed_s - held_s)
            if self._time_s >= self.end_s:
                self._time_s, self._playing = self.end_s, False

    def seek(self, time_s: float) -> None:
        """Goes to a time, or as near as the recording has."""
        with self._lock:
            self._time_s = min(max(time_s, self.begin_s), self.end_s)
        self.touch()

    def scrub(self, time_s: float) -> None:
        """As ``seek``, by a hand that may go on moving."""
        with self._lock:
            self._hold_s = SCRUB_HOLD_S
        self.seek(time_s)

    def toggle(self) -> None:
        """Plays or pauses; at the end it plays from the start."""
        with self._lock:
            if not self._playing and self._time_s >= self.end_s:
                self._time_s = self.begin_s
            self._playing, self._hold_s = not self._playing, 0.0
        self.touch()

    def set_speed(self, speed: float) -> None:
        """Recorded seconds in each second."""
        with self._lock:
            self._speed = speed
        self.touch()

    def step(self, stops_s: Array, direction: int) -> None:
        """Pauses, and goes to the next (+1) or the previous (-1) of these ascending times, if there is one."""
        with self._lock:
            self._playing = False
        # A hair's breadth, so that a time that went through the slider's two decimals is not stepped to again.
        side, hair_s = ("right", 1e-3) if direction > 0 else ("left", -1e-3)
        index = int(np.searchsorted(stops_s, self._time_s + hair_s, side=side)) - (0 if direction > 0 else 1)
        if 0 <= index < len(stops_s):
            self.seek(float(stops_s[index]))
