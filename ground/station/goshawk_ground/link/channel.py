"""How one telemetry channel arrives: rate, age, bandwidth and loss over the last few seconds, in bounded memory."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from goshawk_dashboards.state.views import ChannelView

WINDOW_S = 5.0
CAPACITY = 1024
"""Most arrivals kept: 5 s at 200 Hz. At higher rates the window is shorter."""


@dataclass(frozen=True, slots=True)
class _Arrival:
    time_s: float
    size: int
    seq: int | None


class ChannelStats:
    """Counts arrivals; times are seconds of one monotonic clock, given by the caller."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._arrivals: deque[_Arrival] = deque(maxlen=CAPACITY)
        self._count = 0
        self._malformed = 0
        self._last_s: float | None = None

    def arrived(self, time_s: float, size: int, seq: int | None) -> None:
        """One well-formed sample. A ``seq`` that does not grow means that the sender began anew."""
        if seq is not None and self._arrivals:
            previous = self._arrivals[-1].seq
            if previous is not None and seq <= previous:
                self._arrivals.clear()
        self._arrivals.append(_Arrival(time_s, size, seq))
        self._count += 1
        self._last_s = time_s

    def malformed(self) -> None:
        """One payload that could not be read."""
        self._malformed += 1

    def view(self, now_s: float) -> ChannelView:
        """The figures now."""
        while self._arrivals and now_s - self._arrivals[0].time_s > WINDOW_S:
            self._arrivals.popleft()
        kept = self._arrivals
        # A young channel is measured since its first sample, not over a window it has not lived.
        span_s = max(now_s - kept[0].time_s, 0.5) if kept else WINDOW_S
        # The first arrival opens the span, so what came within it is one less.
        within = len(kept) - 1
        return ChannelView(
            name=self.name,
            count=self._count,
            age_s=None if self._last_s is None else max(0.0, now_s - self._last_s),
            rate_hz=within / span_s if within > 0 else 0.0,
            bytes_per_s=(sum(a.size for a in kept) - kept[0].size) / span_s if within > 0 else 0.0,
            loss_fraction=_loss(kept),
            malformed=self._malformed,
        )


def _loss(kept: deque[_Arrival]) -> float | None:
    if len(kept) < 2:
        return None
    first, last = kept[0].seq, kept[-1].seq
    if first is None or last is None:
        return None
    return 1.0 - len(kept) / (last - first + 1)
