"""What the target filter believes, and how sure it is: deviations, innovation, gate, age, objectness, the rival."""

from __future__ import annotations

import numpy as np

from goshawk_dashboards.instruments.chart import Line, chart_svg
from goshawk_dashboards.instruments.track import AXES
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.html import DIM, NUM, TABLE
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import UNSEEN_S, Array, LookView, TargetView

RIVAL: theme.Rgb = theme.BAD
NONE = "&ndash;"


def target_html(snap: Snapshot) -> str:
    """The filter's state at this instant."""
    target = snap.target if snap.fresh("target") else None
    if target is None:
        return f'<div style="{DIM}">The filter holds no target.</div>'
    return f"{_belief(target)}{_deviations(target)}{_seen(target, target.look)}"


def _belief(target: TargetView) -> str:
    unseen = target.since_seen_s > UNSEEN_S
    color = theme.STALE if not target.confirmed else theme.WARN if unseen else theme.GOOD
    words = "confirmed" if target.confirmed else "not confirmed yet"
    seen = f"unseen for {target.since_seen_s:.1f} s" if unseen else f"seen {1e3 * target.since_seen_s:.0f} ms ago"
    return f'<div><b style="color:{theme.css(color)}">{words}</b>, {seen}</div>'


def _deviations(target: TargetView) -> str:
    """Axis by axis; the last column is the longest axis of the ellipsoid, or the length."""

    def cells(values: Array | None, whole: float | None, digits: int = 2) -> str:
        shown = [None] * 3 if values is None else [float(v) for v in values]
        return "".join(f'<td style="{NUM}">{NONE if v is None else f"{v:.{digits}f}"}</td>' for v in (*shown, whole))

    cov_66 = target.covariance_66
    deviation_6 = None if cov_66 is None else np.sqrt(np.maximum(np.diag(cov_66), 0.0))
    pos_3, vel_3 = (None, None) if deviation_6 is None else (deviation_6[:3], deviation_6[3:])
    inn_3 = None if target.look is None else target.look.innovation_world_3
    rows = (
        ("velocity, m/s", cells(target.vel_world_3, float(np.linalg.norm(target.vel_world_3)), 1)),
        ("&sigma; position, m", cells(pos_3, None if pos_3 is None else float(np.linalg.norm(pos_3)))),
        ("&sigma; velocity, m/s", cells(vel_3, None if vel_3 is None else float(np.linalg.norm(vel_3)))),
        ("innovation, m", cells(inn_3, None if inn_3 is None else float(np.linalg.norm(inn_3)))),
    )
    head = "".join(f'<td style="{NUM}">{axis}</td>' for axis in (*AXES, "length"))
    return (
        f'<table data-goshawk="deviations" style="{TABLE}">'
        f'<tr style="{DIM}"><td></td>{head}</tr>'
        + "".join(f'<tr><td style="white-space:nowrap">{name}</td>{row}</tr>' for name, row in rows)
        + "</table>"
    )


def _seen(target: TargetView, look: LookView | None) -> str:
    """The gate, the detection that the filter took, and what may take the target's place."""
    rows: list[tuple[str, str]] = []
    if look is None:
        rows.append(("detections", "nothing to compare with"))
    else:
        off = NONE if look.innovation_sigmas is None else f"{look.innovation_sigmas:.1f} &sigma;"
        rows.append(("pass the gate", f"{look.passed} of {look.detections} detections"))
        gate = NONE if look.gate_sigmas is None else f"{look.gate_sigmas:g} &sigma;"
        rows.append(("innovation / gate", f"{off} of {gate}"))
        rows.append(("objectness", NONE if look.objectness is None else f"{look.objectness:.2f}"))
        rows.append(("rival", _rival(target, look)))
    body = "".join(f'<tr><td>{name}</td><td style="text-align:right">{value}</td></tr>' for name, value in rows)
    return f'<table data-goshawk="gate" style="{TABLE}">{body}</table>'


def _rival(target: TargetView, look: LookView) -> str:
    """How near it is to taking the target's place, and where it is."""
    if look.rival_pos_world_3 is None:
        return "none"
    off_m = float(np.linalg.norm(look.rival_pos_world_3 - target.pos_world_3))
    return f"objectness {look.rival_objectness:.2f} of {look.rival_needed:.2f} needed, {off_m:.1f} m off"


def target_charts(time_S: Array, columns: dict[str, Array], gate_sigmas: float | None, now_s: float | None) -> str:
    """Deviations and innovation, metres and metres a second apart; objectness."""

    def line(name: str, color: theme.Rgb) -> Line:
        return Line(label=name, color=color, values_S=columns[name])

    sigma, soft = theme.TARGET, theme.MEASURED
    gate = (
        ""
        if gate_sigmas is None
        else chart_svg(
            f"innovation in \u03c3; the gate is {gate_sigmas:g}",
            time_S,
            [line("sigmas", soft)],
            least=gate_sigmas,
            now_s=now_s,
        )
    )
    return (
        chart_svg("\u03c3 of the position (orange), innovation (grey), m", time_S,
                  [line("innovation", soft), line("position", sigma)], least=0.2, now_s=now_s)
        + gate
        + chart_svg("\u03c3 of the velocity, m/s", time_S, [line("velocity", sigma)], least=0.5, now_s=now_s)
        + chart_svg("objectness (green), of the rival (red)", time_S,
                    [line("rival", RIVAL), line("objectness", theme.GOOD)], least=1.0, now_s=now_s)
    )  # fmt: skip
