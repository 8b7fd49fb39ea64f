"""Several vehicles at a glance: one row each, whichever of them is shown in full."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.html import DIM, NUM, pill, table
from goshawk_dashboards.page.status import MODE_COLORS
from goshawk_dashboards.state import words
from goshawk_dashboards.state.alerts import alerts
from goshawk_dashboards.state.snapshot import Snapshot


def fleet_html(snaps: Sequence[Snapshot], shown: str) -> str:
    """Name, mode, speed, distance to the target, battery and worst alert of each; the one shown is marked."""
    head = f'<tr style="{DIM};font-size:11px"><td></td><td></td>' + "".join(
        f'<td style="{NUM}">{title}</td>' for title in ("m/s", "target", "battery")
    )
    return table("fleet", head + "</tr>" + "".join(_rows(snap, snap.vehicle == shown) for snap in snaps))


def _rows(snap: Snapshot, shown: bool) -> str:
    stale, mode = snap.stale, snap.mode
    color = theme.BAD if mode is None else (theme.STALE if stale else MODE_COLORS.get(mode, theme.WARN))
    word = "" if mode is None else words.mode(mode)
    label = "no vehicle" if mode is None else (f"{word} (silent)" if stale else word)
    mark = f"border-left:3px solid {theme.css(theme.VEHICLE) if shown else 'transparent'};padding-left:6px"
    cells = "".join(f'<td style="{NUM};{"opacity:.4" if stale else ""}">{value}</td>' for value in _figures(snap))
    trouble = alerts(snap)
    below = ""
    if trouble:
        ink = theme.css(theme.BAD if trouble[0].severe else theme.WARN)
        below = (
            f'<tr><td colspan="5" style="{mark};color:{ink};font-size:11px">&#9888; {escape(trouble[0].text)}'
            f"{f' (+{len(trouble) - 1})' if len(trouble) > 1 else ''}</td></tr>"
        )
    return (
        f'<tr data-vehicle="{escape(snap.vehicle)}" data-mode="{word}" data-stale="{str(stale).lower()}" '
        f'data-shown="{str(shown).lower()}"><td style="{mark}"><b style="color:#fff">{escape(snap.vehicle)}</b></td>'
        f"<td>{pill(label, color, 11)}</td>{cells}</tr>{below}"
    )


def _figures(snap: Snapshot) -> tuple[str, str, str]:
    control, target, health = snap.control, snap.target, snap.health
    speed = "&ndash;" if control is None else f"{float(np.linalg.norm(control.vel_world_3)):.1f}"
    distance = "&ndash;"
    if control is not None and target is not None and target.confirmed and snap.fresh("target"):
        distance = f"{float(np.linalg.norm(target.pos_world_3 - control.pos_world_3)):.1f} m"
    battery = "&ndash;"
    if health is not None and health.battery_fraction is not None:
        battery = f"{100 * health.battery_fraction:.0f} %"
    return speed, distance, battery
