"""Moments that several flights have in common, by which they are laid over each other. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from goshawk_dashboards.log.flight import Flight

START, TAKE_OFF = "start of the log", "take-off"
SHORT_S = 0.1
"""A shorter phase is passed through on the way to another one."""


def moments(flight: Flight) -> dict[str, float]:
    """The first time of each phase, and of each thing that was told, s."""
    found = {START: 0.0}
    for phase in flight.phases:
        if phase.duration_s >= SHORT_S or phase.name == TAKE_OFF:
            found.setdefault(phase.name, phase.start_s)
    for event in flight.events:
        found.setdefault(event.text, (event.stamp_ns - flight.start_ns) * 1e-9)
    return found


def common(flights: Sequence[Flight]) -> dict[str, tuple[float, ...]]:
    """For each moment that all flights have: how much later each must be shown, s, such that it meets the first's."""
    each = [moments(flight) for flight in flights]
    return {
        name: tuple(each[0][name] - found[name] for found in each)
        for name in each[0]
        if all(name in found for found in each)
    }
