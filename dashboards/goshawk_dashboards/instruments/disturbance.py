"""The disturbance that the observer estimates: as an arrow, in numbers, as a share of its limit, and axis by axis."""

from __future__ import annotations

import math

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.instruments.chart import Line, chart_svg
from goshawk_dashboards.instruments.track import ACCELERATIONS, AXES, Track
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.html import DIM, NUM, TABLE
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array, ControlView

COLORS: dict[str, theme.Rgb] = {
    "desired": theme.GOOD,
    "commanded": theme.VEHICLE,
    "measured": theme.MEASURED,
    "disturbance": theme.DISTURBANCE,
    "true": theme.TRUTH,
}
DASHED = frozenset({"true"})
"""Nothing on board knows it."""
LEAST_MPS2 = 1.0
ROSE_MPS2 = 6.0
"""Radius of the rose where the vehicle does not tell the limit."""
HIGH, FULL = 0.6, 0.9
"""Shares of the limit from which the disturbance is worth a look, and from which the observer may be at its end."""


def disturbance_html(snap: Snapshot, track: Track) -> str:
    """Arrow and numbers of this instant, with the swatches of the charts."""
    control = snap.control
    if control is None:
        return f'<div style="{DIM}">no controller step yet</div>{_legend(snap)}'
    if not track.airborne(snap):
        return f'<div style="{DIM}">On the ground: what stands there feels no wind.</div>{_legend(snap)}'
    if control.mode == pb.MODE_FAULT:
        return f'<div style="{DIM}">Handed back to the autopilot: nothing is estimated.</div>{_legend(snap)}'
    size, limit_mps2 = float(np.linalg.norm(control.acc_disturbance_world_3)), control.disturbance_limit_mps2
    share = None if not limit_mps2 else size / limit_mps2
    color = theme.DISTURBANCE if share is None or share < HIGH else theme.WARN if share < FULL else theme.BAD
    limit = (
        f'<span style="{DIM}">of a limit that it does not tell</span>'
        if share is None
        else f"{100.0 * share:.0f} % of {limit_mps2:g} m/s&sup2;"
    )
    return (
        '<div style="display:flex;gap:10px;align-items:center">'
        f"{_rose(control.acc_disturbance_world_3, limit_mps2 or ROSE_MPS2, color)}"
        f'<div><div style="font-size:20px;font-weight:600;color:{theme.css(color)}" data-goshawk="disturbance-size">'
        f'{size:.1f} m/s&sup2;</div><div>{limit}</div><div style="{DIM}">{_towards(control.acc_disturbance_world_3)}'
        f"</div></div></div>{_numbers(snap, control)}"
    )


def _towards(push_3: Array) -> str:
    """Where it pushes, in words."""
    flat = float(np.hypot(push_3[0], push_3[1]))
    if flat < 0.2:
        return "pushes nowhere sideways"
    names = ("east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east")
    return f"pushes {names[round(math.atan2(push_3[1], push_3[0]) / (math.pi / 4)) % 8]}"


def _rose(push_3: Array, radius_mps2: float, color: theme.Rgb) -> str:
    """Seen from above, north up, the circle is the limit; beside it the part upward."""
    east, north, up = (float(v) / radius_mps2 for v in push_3)
    ink = theme.css(color)
    over = max(1.0, math.hypot(east, north))
    x, y = 48 + 36 * east / over, 48 - 36 * north / over
    z = 48 - 36 * float(np.clip(up, -1.0, 1.0))
    return (
        '<svg viewBox="0 0 124 96" width="124" height="96" style="flex:none" font-size="11" fill="#8b95a5" '
        'font-family="system-ui,sans-serif" stroke="none"><circle cx="48" cy="48" r="36" fill="none" stroke="#566072"/>'
        '<circle cx="48" cy="48" r="18" fill="none" stroke="#2a303b"/><path d="M12 48H84M48 12V84" stroke="#2a303b"/>'
        '<text x="48" y="10" text-anchor="middle">N</text><text x="87" y="52">E</text>'
        f'<path d="M48 48L{x:.1f} {y:.1f}" stroke="{ink}" stroke-width="3" stroke-linecap="round"/>'
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{ink}"/>'
        '<path d="M108 12V84M104 48H112" stroke="#566072"/><text x="108" y="10" text-anchor="middle">up</text>'
        f'<path d="M108 48V{z:.1f}" stroke="{ink}" stroke-width="4"/><circle cx="108" cy="{z:.1f}" r="4" fill="{ink}"/>'
        "</svg>"
    )


def _numbers(snap: Snapshot, control: ControlView) -> str:
    """Every acceleration, axis by axis; their names are the legend of the charts."""
    true_3 = snap.truth.acc_world_3 if snap.truth is not None and snap.fresh("sim_truth") else None
    rows = (control.acc_des_world_3, control.acc_att_world_3, control.acc_meas_world_3,
            control.acc_disturbance_world_3, true_3)  # fmt: skip
    head = "".join(f'<td style="{NUM}">{axis}</td>' for axis in AXES)
    body = "".join(
        f"<tr><td>{_swatch(name)} {name}{'' if acc_3 is not None else ' (no IMU)'}</td>"
        + "".join(f'<td style="{NUM}">{"&ndash;" if acc_3 is None else f"{acc_3[k]:+.1f}"}</td>' for k in range(3))
        + "</tr>"
        for name, acc_3 in zip(ACCELERATIONS, rows, strict=True)
        if acc_3 is not None or name == "measured"
    )
    return (
        f'<table data-goshawk="accelerations" style="{TABLE}">'
        f'<tr style="{DIM}"><td>m/s&sup2;</td>{head}</tr>{body}</table>'
    )


def _legend(snap: Snapshot) -> str:
    """What the charts draw, where no number of this instant stands beside a name."""
    names = (name for name in ACCELERATIONS if name != "true" or snap.truth is not None)
    words = "".join(f'<span style="white-space:nowrap">{_swatch(name)} {name}</span>' for name in names)
    return f'<div style="display:flex;flex-wrap:wrap;gap:0 12px">{words}</div>'


def _swatch(name: str) -> str:
    style = "dashed" if name in DASHED else "solid"
    return (
        f'<span style="display:inline-block;width:16px;vertical-align:middle;border-top:3px {style} '
        f'{theme.css(COLORS[name])}"></span>'
    )


def disturbance_charts(time_S: Array, columns: dict[str, Array], now_s: float | None) -> str:
    """One an axis, all accelerations in each."""
    return "".join(
        chart_svg(
            f"acceleration {axis}, m/s\u00b2",
            time_S,
            [
                Line(label=name, color=COLORS[name], values_S=columns[f"{name} {axis}"], dashed=name in DASHED)
                for name in ACCELERATIONS
            ],
            least=LEAST_MPS2,
            signed=True,
            now_s=now_s,
        )
        for axis in AXES
    )
