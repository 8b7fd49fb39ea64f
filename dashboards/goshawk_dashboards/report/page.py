"""A flight's page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.instruments.panel import panel_html
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import begins_s, estimates_at, snapshot_at
from goshawk_dashboards.page.status import grouped
from goshawk_dashboards.report.latency import Latencies
from goshawk_dashboards.report.made import Report
from goshawk_dashboards.report.over_time import over_time
from goshawk_dashboards.report.parameters import changes
from goshawk_dashboards.report.shell import document, panel, tiles
from goshawk_dashboards.report.summary import GOOD_OUTCOMES, ON_TASK, Card, Figures, Spread
from goshawk_dashboards.report.tracking import Tracking
from goshawk_dashboards.state import words

PHASE_COLORS = {
    "on the ground": "#b3bac1", "landed": "#b3bac1", "take-off": "#8fc1ea", "tracking": "#74cf9f",
    "navigation": "#74cf9f", "lost": "#f0a35e", "search": "#f3d06b", "hold": "#a9d8d2",
    "landing": "#b9a7e6", "fault": "#f2777a",
}  # fmt: skip


ESTIMATE_ROWS = 600
OVER_TIME = ("velocity", "disturbance", "clearance")
"""Figures whose curves the page has as charts."""


def page(report: Report) -> str:
    """The whole page."""
    flight, card = report.flight, report.card
    parts = [
        _head(card),
        _tiles(report),
        _why(report.why),
        _phases(flight),
        _faults(card),
        over_time(flight, report.seen, PHASE_COLORS),
        _estimates(flight),
        *(panel(figure) for figure in report.figures if figure.name not in OVER_TIME),
        _told(report.latencies),
        _changes(report),
        _events(flight),
        _facts(flight, card),
    ]
    return document(f"{card.path.name}: {card.outcome}", parts)


def _head(card: Card) -> str:
    what = [card.vehicle or "unnamed vehicle", card.profile, card.wall_time or "simulated, without a date"]
    line = " · ".join(escape(part) for part in what if part)
    return f"<header><h1>{escape(card.path.name)}</h1><p class='soft'>{line}</p></header>"


def _tiles(report: Report) -> str:
    card = report.card
    tone = "good" if card.outcome in GOOD_OUTCOMES and not card.faults else "bad"
    outcome = f"<div class='tile'><b class='{tone}'>{escape(card.outcome)}</b><span>outcome</span></div>"
    return tiles((*_numbers(card, report.numbers), *_held(report.tracking)), outcome)


def _numbers(card: Card, n: Figures) -> Iterator[tuple[str, str, str]]:
    """Name, value and unit of all that is known."""
    yield "duration", f"{card.duration_s:.1f}", "s"
    yield "flown", f"{n.path_m:.1f}", "m"
    plain = (
        ("mean speed on its task", n.mean_speed_mps, "m/s", 1.0, 1),
        ("top speed", n.max_speed_mps, "m/s", 1.0, 1),
        ("greatest acceleration", n.max_acceleration_mps2, "m/s²", 1.0, 1),
        ("mean disturbance", n.mean_disturbance_mps2, "m/s²", 1.0, 2),
        ("target in sight", n.in_sight_fraction, "%", 100.0, 0),
        ("nearest obstacle seen", n.nearest_seen_m, "m", 1.0, 2),
        ("true clearance", n.true_clearance_m, "m", 1.0, 2),
        ("planner", n.planner_hz, "Hz", 1.0, 0),
        ("controller", n.controller_hz, "Hz", 1.0, 0),
    )
    for name, value, unit, scale, digits in plain:
        if value is not None:
            yield name, f"{scale * value:.{digits}f}".replace("-", "−"), unit
    if n.collisions:
        yield "collisions", str(n.collisions), ""
    spreads = (
        ("lateral error, 5–95 %", n.target_lateral_m, "m", 2),
        ("longitudinal error, 5–95 %", n.target_longitudinal_m, "m", 2),
    )
    for name, spread, unit, digits in spreads:
        if spread is not None:
            yield name, _range(spread, digits), unit
    if n.frame_to_plan_ms is not None:
        yield "exposure to plan, median", f"{n.frame_to_plan_ms.p50:.1f}", "ms"


def _held(t: Tracking) -> Iterator[tuple[str, str, str]]:
    """The same of what it held and how near its limits it was."""
    parts = (
        ("attitude error, RMS", t.attitude_rms_deg, "°", 1.0, 1),
        ("of the time at a thrust limit", t.thrust_at_limit_fraction, "%", 100.0, 1),
        ("vibration, RMS", t.vibration_rms_mps2, "m/s²", 1.0, 2),
        ("greatest doubt of the odometry", t.odometry_doubt_most, "of its gate", 1.0, 2),
        ("target within 2 σ", t.target_within_2_sigma_fraction, "%", 100.0, 0),
    )
    for name, value, unit, scale, digits in parts:
        if value is not None:
            yield name, f"{scale * value:.{digits}f}", unit
    if t.battery_start_fraction is not None and t.battery_end_fraction is not None:
        yield "battery", f"{100.0 * t.battery_start_fraction:.0f} → {100.0 * t.battery_end_fraction:.0f}", "%"


def _why(sentences: Sequence[str]) -> str:
    if not sentences:
        return ""
    rows = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<section class='panel' id='why'><h2>Why it ended so</h2><ul>{rows}</ul></section>"


def _changes(report: Report) -> str:
    if report.before is None:
        return ""
    found = changes(report.before.header, report.flight.header)
    head = f"<h2>Parameters since {escape(report.before.name)}</h2>"
    if not found:
        return f"<section class='panel' id='changes'>{head}<p class='soft'>None has changed.</p></section>"
    rows = "".join(
        f"<tr><td>{escape(c.name)}</td><td>{escape(c.before)}</td><td>{escape(c.now)}</td></tr>" for c in found
    )
    return (
        f"<section class='panel' id='changes'>{head}<table><thead><tr><th></th><th>before</th><th>now</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></section>"
    )


def _range(spread: Spread, digits: int) -> str:
    return f"{spread.p5:+.{digits}f} … {spread.p95:+.{digits}f}".replace("-", "−")


def _phases(flight: Flight) -> str:
    if not flight.phases:
        return ""
    room_s = 0.008 * (flight.phases[-1].end_s - flight.phases[0].start_s)
    bars = "".join(
        f"<div style='flex:{max(p.duration_s, 1e-3):.3f} 0 0;background:{PHASE_COLORS.get(p.name, '#b3bac1')}' "
        f"title='{escape(p.name)}: {p.start_s:.2f} … {p.end_s:.2f} s'>"
        f"{escape(p.name) if p.duration_s > room_s * len(p.name) else ''}</div>"
        for p in flight.phases
    )
    return f"<section class='panel'><h2>Phases</h2><div class='phases'>{bars}</div></section>"


def _faults(card: Card) -> str:
    if not card.faults:
        return "<section class='panel'><h2>Faults</h2><p class='soft'>None was logged.</p></section>"
    rows = "".join(f"<li>{escape(fault)}</li>" for fault in card.faults)
    return f"<section class='panel'><h2 class='bad'>Faults</h2><ul>{rows}</ul></section>"


def _estimates(flight: Flight) -> str:
    """The instrument panel at the end of the flight's task, with all that came before."""
    on_task = [p for p in flight.phases if p.name in ON_TASK]
    if not on_task:
        return ""
    end_s, from_s = on_task[-1].end_s, begins_s(flight)
    # Just before, while it was in the phase: the next one may be on the ground, or another's to fly.
    last_s = end_s - 1e-3
    every_s = max((end_s - from_s) / ESTIMATE_ROWS, 0.05)
    track = Track.of(estimates_at(flight, float(t)) for t in np.append(np.arange(from_s, last_s, every_s), last_s))
    panel = panel_html(snapshot_at(flight, last_s), track, window_s=end_s - from_s + 1.0)
    return (
        f"<section class='panel' id='estimates'><h2>Estimates</h2><p class='soft'>At {end_s:.2f} s, the end of its "
        f"task, and until then.</p>{panel}</section>"
    )


def _told(latencies: Latencies) -> str:
    if not latencies.told:
        return ""
    rows = "".join(
        f"<tr><td>{escape(x.name.replace('_', ' '))}</td>"
        + "".join(f"<td class='number'>{v:.3f}</td>" for v in (x.p50_ms, x.p99_ms, x.max_ms))
        + "</tr>"
        for x in latencies.told
    )
    names = "".join(f"<th class='number'>{name}</th>" for name in ("p50, ms", "p99, ms", "max, ms"))
    return (
        "<section class='panel'><h2>Latency as the vehicle told it last</h2>"
        f"<table><thead><tr><th></th>{names}</tr></thead><tbody>{rows}</tbody></table></section>"
    )


def _events(flight: Flight) -> str:
    """By their time. What comes again and again is one line, counted, where it came last."""
    if not flight.events:
        return ""
    rows = "".join(
        f"<tr><td class='number'>{(e.stamp_ns - flight.start_ns) * 1e-9:.2f}</td>"
        f"<td{'' if e.severity == pb.SEVERITY_INFO else ' class=bad'}>{words.severity(e.severity)}</td>"
        f"<td>{escape(e.kind)}</td><td>{escape(e.text)}{f' <b>× {count}</b>' if count > 1 else ''}</td></tr>"
        for e, count in reversed(grouped(flight.events))
    )
    names = "<th class='number'>s</th><th></th><th>kind</th><th>event</th>"
    return (
        "<section class='panel'><h2>Events</h2>"
        f"<table><thead><tr>{names}</tr></thead><tbody>{rows}</tbody></table></section>"
    )


def _facts(flight: Flight, card: Card) -> str:
    facts = {
        "policy": f"{card.task or 'unknown task'}, SHA-256 {card.policy_sha256 or 'unknown'}",
        "version": f"{card.version or 'unknown'}, revision {card.git_revision or 'unknown'}",
        "log": f"{card.size_bytes / 1e6:.1f} MB, " + flight.completeness,
        "records": ", ".join(f"{len(flight.log.times_ns(topic))} {topic}" for topic in flight.log.topics),
    }
    if flight.malformed:
        facts["malformed"] = f"{flight.malformed} records made no sense and were left out"
    rows = "".join(f"<dt>{name}</dt><dd>{escape(value)}</dd>" for name, value in facts.items())
    header = flight.header
    texts = {"vehicle file": header.vehicle_toml, "tuning file": header.tuning_toml}
    files = "".join(
        f"<details><summary>{name}</summary><pre>{escape(text)}</pre></details>" for name, text in texts.items() if text
    )
    return f"<section class='panel'><h2>Log</h2><dl>{rows}</dl>{files}</section>"
