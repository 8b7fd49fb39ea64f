"""The estimates of the seconds before an instant, for the instrument panel: gone on with while time runs on."""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.instruments.panel import WINDOW_S
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import begins_s, estimates_at

EVERY_S = 0.1


class Past:
    """For one viewer of a flight."""

    def __init__(self, flight: Flight) -> None:
        self._flight = flight
        self._track, self._until_s = Track(), -np.inf

    def until(self, time_s: float) -> Track:
        """The track that ends at a time; after a jump it is read anew."""
        if not 0.0 <= time_s - self._until_s <= WINDOW_S:
            self._track = Track()
            # Where it stood tells the height that it lifts off from.
            begin_s = begins_s(self._flight)
            self._track.add(estimates_at(self._flight, begin_s))
            self._until_s = max(begin_s, time_s - WINDOW_S)
        while self._until_s + EVERY_S <= time_s:
            self._until_s += EVERY_S
            self._track.add(estimates_at(self._flight, self._until_s))
        return self._track
