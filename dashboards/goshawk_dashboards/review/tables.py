"""The tables of a review, as HTML: candidates, marks, the log itself. Every text from outside is escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.recorded import Mark
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.candidates import table_html, words_of
from goshawk_dashboards.review.timeline import MARK_COLORS
from goshawk_dashboards.scene import curves
from goshawk_dashboards.state.views import PlanView

DIM = "#8b95a5"
FONT = "font:11px/16px system-ui,sans-serif;font-variant-numeric:tabular-nums"


def candidates_html(
    plan: PlanView | None, columns: int, replayed: PlanView | None, who: str = "the other policy"
) -> str:
    """The candidates as the lattice has them, seen along the camera: cost, and objectness beneath.

    The flown one is framed in white, what was ``replayed`` by ``who`` in its colour.
    """
    if plan is None or len(plan.cost_N) == 0:
        return f'<div data-goshawk="candidates" style="{FONT};color:{DIM};padding:2px 12px">no plan at this time</div>'
    colors_N3 = curves.colors_N3(plan)
    other = replayed.chosen if replayed is not None else None
    cells = "".join(_cell(plan, k, colors_N3[k], k == plan.chosen, k == other) for k in range(len(plan.cost_N)))
    chosen = "nothing was eligible" if plan.chosen is None else f"candidate {plan.chosen + 1} flown"
    words = f"plan {plan.seq}, {chosen}, lasts {plan.duration_s:.2f} s"
    if replayed is not None:
        words += f'; <span style="color:{theme.css(theme.REPLAY)}">{_replay_words(plan, replayed, who)}</span>'
    return (
        f'<div data-goshawk="candidates" data-seq="{plan.seq}" style="{FONT};color:#aab3c0;padding:2px 12px">'
        f'<div style="display:grid;grid-template-columns:repeat({columns},1fr);gap:3px">{cells}</div>'
        f'<div style="margin-top:4px">{words}</div></div>{table_html(plan)}'
    )


def _cell(plan: PlanView, k: int, rgb: np.ndarray, flown: bool, other: bool) -> str:
    color: theme.Rgb = (int(rgb[0]), int(rgb[1]), int(rgb[2]))
    frame = theme.css(theme.REPLAY) if other and not flown else ("#fff" if flown else "transparent")
    return (
        f'<div title="{escape(words_of(plan, k))}" style="background:{theme.css(color, 0.28)};'
        f'text-align:center;border:2px solid {frame};border-radius:4px;line-height:13px;padding:1px 0">'
        f'<b style="color:#fff">{plan.cost_N[k]:.2f}</b>'
        f'<div style="font-size:10px">{100 * plan.objectness_N[k]:.0f} %</div></div>'
    )


def _replay_words(plan: PlanView, replayed: PlanView, who: str) -> str:
    if replayed.chosen is None:
        return f"{who} chose nothing"
    if plan.chosen is None:
        return f"{who} chose {replayed.chosen + 1}"
    apart_m = float(np.linalg.norm(replayed.end_pos_world_N3[replayed.chosen] - plan.end_pos_world_N3[plan.chosen]))
    return f"{who} chose {replayed.chosen + 1}, {apart_m:.2f} m apart at the end"


def _ink(mark: Mark) -> str:
    """What is only told has the text's own colour."""
    if mark.severity == pb.SEVERITY_INFO:
        return ""
    return f"color:{theme.css(MARK_COLORS.get(mark.severity, theme.TRUTH))}"


def marks_html(marks: Sequence[Mark], time_s: float, shown: int = 9) -> str:
    """The marks around a time, the last one that has passed in bold."""
    current = int(np.searchsorted([m.time_s for m in marks], time_s + 5e-3, side="right")) - 1
    first = min(max(current - shown // 2, 0), max(len(marks) - shown, 0))
    rows = "".join(
        f'<tr style="{"font-weight:600;color:#fff" if first + k == current else ""}">'
        f'<td style="text-align:right;padding-right:8px;color:{DIM};white-space:nowrap">{m.time_s:.2f} s</td>'
        f'<td style="{_ink(m)}">{escape(m.text)}</td></tr>'
        for k, m in enumerate(marks[first : first + shown])
    )
    return (
        f'<div data-goshawk="marks" style="{FONT};font-size:12px;color:#d7dde6;padding:2px 12px">'
        f'<table style="border-collapse:collapse">{rows}</table></div>'
    )


def flight_html(flight: Flight, beside: str = "") -> str:
    """What the log says of itself, and how another one lies ``beside`` it."""
    header = flight.header
    flaw = "" if flight.completeness == "complete" else f", {flight.completeness}"
    facts = (
        ("log", flight.path.name),
        ("recorded", header.wall_time),
        ("vehicle", header.vehicle),
        ("profile", header.profile),
        ("policy", header.policy_sha256[:12]),
        ("version", " ".join(filter(None, (header.version, header.git_revision[:12])))),
        ("length", f"{flight.duration_s:.1f} s{flaw}"),
        ("beside", beside),
    )
    rows = "".join(
        f'<tr><td style="color:{DIM};padding-right:10px">{name}</td><td style="overflow-wrap:anywhere">'
        f"{escape(value)}</td></tr>"
        for name, value in facts
        if value
    )
    return (
        f'<div data-goshawk="flight" data-closed="{str(flight.closed).lower()}" style="{FONT};font-size:12px;'
        f'color:#d7dde6;padding:2px 12px"><table>{rows}</table></div>'
    )
