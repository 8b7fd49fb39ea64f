"""A flight, worked out: all that its report shows."""

from __future__ import annotations

from dataclasses import dataclass

from goshawk_dashboards.charts.clearance import Clearance, seen_clearance
from goshawk_dashboards.charts.errors import target_errors
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.progress import Progress, unheard
from goshawk_dashboards.report import figures as drawn
from goshawk_dashboards.report.canvas import Figure
from goshawk_dashboards.report.latency import Latencies, latencies
from goshawk_dashboards.report.parameters import Earlier
from goshawk_dashboards.report.summary import Card, Figures, card, figures
from goshawk_dashboards.report.tracking import Tracking, spectrum_of, tracking
from goshawk_dashboards.report.why import why


@dataclass(frozen=True, kw_only=True)
class Report:
    """A flight, worked out."""

    flight: Flight
    card: Card
    numbers: Figures
    figures: tuple[Figure, ...]
    latencies: Latencies
    tracking: Tracking
    why: tuple[str, ...]
    seen: Clearance | None
    before: Earlier | None
    """The flight before, whose parameters are compared."""


def make_report(flight: Flight, before: Earlier | None = None, progress: Progress = unheard) -> Report:
    """Reads the whole flight; ``before`` is the one whose parameters are compared with its own."""
    seen, errors, found = seen_clearance(flight, progress), target_errors(flight), latencies(flight)
    spectrum = spectrum_of(flight)
    material = drawn.Material(flight=flight, seen=seen, errors=errors, latencies=found, spectrum=spectrum)
    return Report(
        flight=flight,
        card=card(flight),
        numbers=figures(flight, seen, errors, found),
        figures=tuple(drawn.figures(material)),
        latencies=found,
        tracking=tracking(flight, spectrum),
        why=tuple(why(flight)),
        seen=seen,
        before=before,
    )
