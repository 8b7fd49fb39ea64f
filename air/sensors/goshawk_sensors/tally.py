"""What a person wants to know of the images that went by: how many, how late, how good."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np

from goshawk_sensors.cameras.source import Frame
from goshawk_sensors.view.resample import Millimetres, Resampler


@dataclass(kw_only=True)
class Tally:
    """Of the images since it was made."""

    lost: int = 0
    """By the camera's count, on their way here."""
    stamp_source: str = "none"
    _taken_s: list[float] = field(default_factory=list[float])
    _late_ms: list[float] = field(default_factory=list[float])
    _work_ms: list[float] = field(default_factory=list[float])
    _measured: list[float] = field(default_factory=list[float])
    _number: int | None = None

    def take(self, frame: Frame, depth_mm: Millimetres) -> None:
        """An image that has just been sent."""
        sent_ns = time.monotonic_ns()
        gap = 1 if self._number is None else frame.number - self._number
        self.lost += max(0, gap - 1)  # a camera or recording that begins again counts from 0
        self._number = frame.number
        self.stamp_source = frame.stamp.source
        self._taken_s.append(1e-9 * frame.stamp.monotonic_ns)
        self._late_ms.append(1e-6 * (sent_ns - frame.stamp.monotonic_ns))
        self._work_ms.append(1e-6 * (sent_ns - frame.arrival_ns))
        self._measured.append(np.count_nonzero(depth_mm) / depth_mm.size)

    @property
    def count(self) -> int:
        return len(self._taken_s)

    @property
    def rate_hz(self) -> float:
        span_s = self._taken_s[-1] - self._taken_s[0] if self._taken_s else 0.0
        return (self.count - 1) / span_s if span_s > 0.0 else 0.0

    @property
    def measured(self) -> float:
        """The share of pixels with a depth."""
        return float(np.mean(self._measured)) if self._measured else 0.0

    @property
    def latency(self) -> str:
        late, work = (np.percentile(each, [50, 99]) for each in (self._late_ms, self._work_ms))
        return (
            f"{late[0]:.1f} ms from exposure to sent (99 %: {late[1]:.1f}), {work[0]:.1f} ms of it here ({work[1]:.1f})"
        )

    def line(self) -> str:
        """All of it in one."""
        if not self.count:
            return "no image"
        return f"{self.rate_hz:.1f} Hz, {self.lost} lost, {self.measured:.0%} with depth, {self.latency}"


def view(resampler: Resampler) -> str:
    """What goes out, in words."""
    lens = resampler.view
    fov = f"{math.degrees(resampler.hfov_rad):.1f} x {math.degrees(resampler.vfov_rad):.1f} degrees"
    rim = "" if resampler.seen > 0.995 else f", depth sees {resampler.seen:.0%} of it"
    border = "" if resampler.shown == 1.0 else f", colour {resampler.shown:.0%}"
    return f"{lens.width} x {lens.height} pixels, {fov}{rim}{border}"
