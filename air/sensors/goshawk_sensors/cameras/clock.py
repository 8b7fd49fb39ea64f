"""When an image was taken: the middle of its exposure on CLOCK_MONOTONIC.

A RealSense says when its read-out began, by its own clock (`frame_us`) and by this host's wall clock (`wall_ms`, global
time), and when the middle of the exposure was, by its own clock (`sensor_us`). The two of its own clock give how long
ago the middle was when the read-out began. Where it does not say, half the exposure takes its place; where it says
nothing of use, the arrival less what the profile says it takes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

LONGEST_NS = 250_000_000
"""An image that is older than this when it arrives has a wrong stamp: the wall clock was set."""


@dataclass(frozen=True, kw_only=True)
class Told:
    """What came with an image. None: the camera did not say."""

    wall_ms: float | None
    """The begin of the read-out, by this host's wall clock."""
    frame_us: int | None = None
    """The same by the camera's clock."""
    sensor_us: int | None = None
    """The middle of the exposure by the camera's clock."""
    exposure_us: int | None = None
    """How long it was."""


@dataclass(frozen=True, kw_only=True)
class Moment:
    """One instant by both clocks of this host."""

    wall_ns: int
    monotonic_ns: int


def now() -> Moment:
    return Moment(wall_ns=time.time_ns(), monotonic_ns=time.monotonic_ns())


@dataclass(frozen=True, kw_only=True)
class Stamp:
    """The middle of an exposure, and how it is known."""

    monotonic_ns: int
    source: str


def stamp(told: Told, arrival: Moment, latency_ms: float) -> Stamp:
    """Of an image that has just arrived."""
    if told.wall_ms is not None:
        source, before_ns = _before_read_out(told)
        middle_ns = round(told.wall_ms * 1e6) - before_ns - arrival.wall_ns + arrival.monotonic_ns
        if source and 0 <= arrival.monotonic_ns - middle_ns <= LONGEST_NS:
            return Stamp(monotonic_ns=middle_ns, source=source)
    source = f"its arrival less {latency_ms:g} ms"
    return Stamp(monotonic_ns=arrival.monotonic_ns - round(latency_ms * 1e6), source=source)


def _before_read_out(told: Told) -> tuple[str, int]:
    if told.frame_us is not None and told.sensor_us is not None:
        return "the sensor's timestamp", 1000 * (told.frame_us - told.sensor_us)
    if told.exposure_us is not None:
        return "the read-out less half the exposure", 500 * told.exposure_us
    return "", 0


class Replayed:
    """The stamps of a recording that is played: as far apart as they were taken, and as if each arrived at once."""

    def __init__(self) -> None:
        self._offset_ns: int | None = None

    def stamp(self, recorded_ms: float, arrival_ns: int) -> Stamp:
        """Never later than the arrival."""
        taken_ns = round(recorded_ms * 1e6)
        late_ns = arrival_ns - taken_ns
        if self._offset_ns is None or not self._offset_ns <= late_ns <= self._offset_ns + LONGEST_NS:
            self._offset_ns = late_ns  # the first, one that came sooner, or one after a pause
        return Stamp(monotonic_ns=taken_ns + self._offset_ns, source="the recording's, as if taken now")
