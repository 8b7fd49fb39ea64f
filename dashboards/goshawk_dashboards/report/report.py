"""Puts a report together and writes it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from goshawk_dashboards.charts.clearance import seen_clearance
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report import figures as drawn
from goshawk_dashboards.report.canvas import Figure
from goshawk_dashboards.report.errors import target_errors
from goshawk_dashboards.report.latency import Latencies, latencies
from goshawk_dashboards.report.page import page
from goshawk_dashboards.report.summary import Card, Figures, card, figures


@dataclass(frozen=True, kw_only=True)
class Report:
    """A flight, worked out."""

    flight: Flight
    card: Card
    numbers: Figures
    figures: tuple[Figure, ...]
    latencies: Latencies


def make_report(flight: Flight) -> Report:
    """Reads the whole flight."""
    seen, errors, found = seen_clearance(flight), target_errors(flight), latencies(flight)
    material = drawn.Material(flight=flight, seen=seen, errors=errors, latencies=found)
    return Report(
        flight=flight,
        card=card(flight),
        numbers=figures(flight, seen, errors, found),
        figures=tuple(drawn.figures(material)),
        latencies=found,
    )


def write_page(report: Report, output: Path) -> None:
    """One HTML file that needs no network. Raises OSError."""
    text = page(report.flight, report.card, report.numbers, report.figures, report.latencies)
    output.write_text(text, encoding="utf-8")
