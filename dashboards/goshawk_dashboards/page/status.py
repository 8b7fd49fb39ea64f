"""What the panels say of a snapshot, as HTML: pure functions of a snapshot. Every text from outside is escaped."""

from __future__ import annotations

import re
from html import escape

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.html import DIM, NUM, TEXT, faded, pill, table
from goshawk_dashboards.state import words
from goshawk_dashboards.state.alerts import age_words
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import EventView

MODE_COLORS: dict[pb.Mode, theme.Rgb] = {
    pb.MODE_IDLE: theme.STALE,
    pb.MODE_READY: theme.GOOD,
    pb.MODE_TAKEOFF: theme.VEHICLE,
    pb.MODE_TRACK: theme.GOOD,
    pb.MODE_NAVIGATE: theme.GOOD,
    pb.MODE_SEARCH: theme.WARN,
    pb.MODE_HOLD: theme.VEHICLE,
    pb.MODE_STOPPING: theme.WARN,
    pb.MODE_LANDED: theme.VEHICLE,
    pb.MODE_FAULT: theme.BAD,
}

_MARKS = {True: "&#10003;", False: "&#10007;"}


def status_html(snap: Snapshot, *, flight_s: float | None = None, ground_z_m: float | None = None) -> str:
    """The card at the top: vehicle, link, mode, and the numbers an operator glances at.

    ``flight_s`` since the take-off, ``ground_z_m`` the ground's height in the world frame; None: they are not known.
    """
    age_s = snap.heard_age_s
    stale = snap.stale
    mode = snap.mode
    if mode is None:
        link = "connected, waiting for telemetry" if snap.linked else f"no link to {snap.endpoint}: dialling"
        return (
            f'<div data-goshawk="status" style="{TEXT};padding:10px 12px">{pill("NO VEHICLE", theme.BAD, 15)}'
            f'<div style="{DIM};margin-top:6px">{escape(snap.vehicle)}: {escape(link)}</div></div>'
        )
    color = theme.STALE if stale else MODE_COLORS.get(mode, theme.WARN)
    head = pill(words.mode(mode).upper(), color, 16)
    if stale and age_s is not None:
        head += " " + pill(f"STALE {age_s:.1f} s", theme.BAD, 13)
    elif not snap.alive:
        head += " " + pill("not alive", theme.WARN)
    control = snap.control
    if control is not None and control.fallback != pb.FALLBACK_NONE:
        below = pill("fallback: " + words.fallback(control.fallback), theme.BAD)
        head += f'<div style="margin-top:6px">{below}</div>'
    health = snap.health
    faults = "".join(
        f'<div style="color:{theme.css(theme.BAD)};margin-top:4px">&#9888; {escape(f)}</div>'
        for f in (health.faults if health is not None else ())
    )
    return (
        f'<div data-goshawk="status" data-mode="{words.mode(mode)}" data-stale="{str(stale).lower()}" '
        f'style="{TEXT};padding:10px 12px 4px">'
        f'<div style="display:flex;justify-content:space-between;align-items:center"><div>{head}</div>'
        f'<div style="text-align:right;{DIM}"><b style="color:#fff">{escape(snap.vehicle)}</b><br>'
        f"{escape(health.autopilot if health is not None else '')}</div></div>"
        f"{faults}{faded(_figures(snap, flight_s, ground_z_m), stale)}</div>"
    )


def clock_words(seconds: float) -> str:
    """Minutes and seconds: 1:05."""
    whole = max(0, int(seconds))
    return f"{whole // 60}:{whole % 60:02d}"


def _figures(snap: Snapshot, flight_s: float | None, ground_z_m: float | None) -> str:
    control, target, health, truth = snap.control, snap.target, snap.health, snap.truth
    cells: list[tuple[str, str]] = []
    if control is not None:
        cells.append(("speed", f"{float(np.linalg.norm(control.vel_world_3)):.1f} m/s"))
        height = "height, from its origin" if ground_z_m is None else "above ground"
        cells.append((height, f"{control.pos_world_3[2] - (ground_z_m or 0.0):.1f} m"))
    if control is not None and target is not None and target.confirmed:
        cells.append(("target", f"{float(np.linalg.norm(target.pos_world_3 - control.pos_world_3)):.1f} m"))
    else:
        cells.append(("target", "&ndash;"))
    if flight_s is not None and snap.flying:
        cells.append(("flight time", clock_words(flight_s)))
    if snap.plan is not None and snap.fresh("plan"):
        cells.append(("time scale &alpha;", f"{snap.plan.alpha:.2f}"))
    if health is not None and health.battery_fraction is not None:
        cells.append(("battery", f"{100 * health.battery_fraction:.0f} %"))
    if truth is not None and snap.fresh("sim_truth"):
        cells.append(("clearance", f"{truth.clearance_m:.2f} m"))
        cells.append(("target ran", f"{truth.target_path_m:.0f} m"))
    boxes = "".join(
        f'<div style="flex:1 0 29%;padding:4px 0"><div style="{DIM};font-size:11px">{name}</div>'
        f'<div style="font-size:17px;font-weight:600;color:#fff;white-space:nowrap">{value}</div></div>'
        for name, value in cells
    )
    return f'<div style="display:flex;flex-wrap:wrap;margin-top:8px">{boxes}</div>'


def command_html(snap: Snapshot) -> str:
    """What became of the last command."""
    command = snap.command
    if command is None:
        return ""
    color = theme.WARN if command.pending else (theme.GOOD if command.accepted else theme.BAD)
    verdict = "accepted" if command.accepted else ("refused" if command.answered else "no reply")
    if command.pending:
        verdict = "sent"
    elif command.cancelled or command.refused_here:
        verdict = "cancelled" if command.cancelled else "not sent"
    return (
        f'<div data-goshawk="command" style="{TEXT};padding:0 12px 4px">'
        f'<b style="color:{theme.css(color)}">{escape(command.verb)} {verdict}</b> '
        f"<span>{escape(command.text)}</span></div>"
    )


def readiness_html(snap: Snapshot) -> str:
    """Each check with its reason, the failing ones first."""
    health = snap.health
    if health is None:
        return f'<div style="{TEXT};{DIM};padding:4px 12px">no heartbeat yet</div>'
    rows = "".join(
        f'<tr><td style="width:22px;color:{theme.css(theme.GOOD if c.ok else theme.BAD)}">{_MARKS[c.ok]}</td>'
        f'<td style="white-space:nowrap;padding-right:10px">{escape(c.name.replace("_", " "))}</td>'
        f'<td style="{DIM if c.ok else "color:#fff"}">{escape(c.reason)}</td></tr>'
        for c in sorted(health.checks, key=lambda c: c.ok)
    )
    return faded(table("readiness", rows), snap.stale)


def failing_checks(snap: Snapshot) -> list[str]:
    """What is not ready, one line each; a silent vehicle is one of them."""
    if snap.health is None:
        return ["No heartbeat has come from the vehicle."]
    lines = [f"{c.name.replace('_', ' ')}: {c.reason}" for c in snap.health.checks if not c.ok]
    if snap.stale:
        lines.insert(0, "The vehicle is silent; what is shown here is old.")
    return lines


def learnt_html(snap: Snapshot) -> str:
    """What the controller has learnt of the airframe in flight."""
    control = snap.control
    if control is None:
        return ""
    thrust, lag_s = control.hover_thrust, control.attitude_lag_s
    figures = (
        ("hover thrust", None if thrust is None else f"{100.0 * thrust:.1f} %"),
        ("attitude lag", None if lag_s is None else f"{1e3 * lag_s:.0f} ms"),
    )
    rows = "".join(
        f'<tr><td>{name}, learnt</td><td style="{NUM}">{value}</td></tr>'
        for name, value in figures
        if value is not None
    )
    return faded(table("learnt", rows), not snap.fresh("control"))


def vehicle_html(snap: Snapshot) -> str:
    """What the heartbeat reports: rates, latencies, drops, versions."""
    health = snap.health
    if health is None:
        return f'<div style="{TEXT};{DIM};padding:4px 12px">no heartbeat yet</div>'
    rows = "".join(
        f'<tr><td>{escape(n.replace("_", " "))}</td><td colspan="3" style="{NUM}">{hz:.1f} Hz</td></tr>'
        for n, hz in health.rates_hz
    )
    if health.latencies:
        rows += f'<tr style="{DIM};font-size:11px"><td>latency, ms</td>' + "".join(
            f'<td style="{NUM}">{t}</td>' for t in ("p50", "p99", "max")
        )
        rows += "</tr>" + "".join(
            f"<tr><td>{escape(x.name.replace('_', ' '))}</td>"
            + "".join(f'<td style="{NUM}">{v:.2f}</td>' for v in (x.p50_ms, x.p99_ms, x.max_ms))
            + "</tr>"
            for x in health.latencies
        )
    rows += "".join(
        f'<tr style="color:{theme.css(theme.WARN)}"><td>{escape(n.replace("_", " "))} dropped</td>'
        f'<td colspan="3" style="{NUM}">{count}</td></tr>'
        for n, count in health.drops
        if count
    )
    facts = (
        ("profile", health.profile),
        ("policy", health.policy_sha256[:12]),
        ("version", health.version),
        ("log", health.log_path or "not recording"),
    )
    rows += "".join(
        f'<tr style="{DIM}"><td>{n}</td><td colspan="3" style="text-align:right;overflow-wrap:anywhere">'
        f"{escape(v)}</td></tr>"
        for n, v in facts
    )
    return faded(table("vehicle", rows), snap.stale)


def events_html(snap: Snapshot, *, took_off_ns: int | None = None, newest: int = 10) -> str:
    """The newest events, newest first: by the flight's time, or how long ago where no take-off was seen.

    What comes again and again, as of two modes that flap, is one line, counted.
    """
    colors = {pb.SEVERITY_WARNING: theme.css(theme.WARN), pb.SEVERITY_ERROR: theme.css(theme.BAD)}
    now_ns = max((view.stamp_ns for view in (snap.control, snap.health) if view is not None), default=0)
    rows = "".join(
        f'<tr style="vertical-align:top"><td style="{NUM};{DIM};padding-right:8px">'
        f"{_when(event.stamp_ns, now_ns, took_off_ns)}</td>"
        f'<td style="color:{colors.get(event.severity, "inherit")}">{escape(event.text)}'
        f"{f' <b>&times;&thinsp;{count}</b>' if count > 1 else ''}{LATE if event.late else ''}</td></tr>"
        for event, count in grouped(snap.events)[:newest]
    )
    return table("events", rows or f'<tr><td style="{DIM}">none yet</td></tr>')


LATE = f' <span data-goshawk="late" style="{DIM};white-space:nowrap">told afterwards</span>'
FLAPPING = 4
"""An event like one of so many before it is the same one again."""
_FIGURE = re.compile(r"[0-9]+(\.[0-9]+)?")


def grouped(events: tuple[EventView, ...]) -> list[tuple[EventView, int]]:
    """The newest of each group of like events, the newest first, and how many there are. Their figures may differ."""
    groups: dict[tuple[str, int], tuple[EventView, int]] = {}
    for event in events:
        like = [key for key in list(groups)[-FLAPPING:] if key[0] == _FIGURE.sub("#", event.text)]
        key = like[-1] if like else (_FIGURE.sub("#", event.text), event.stamp_ns)
        _, count = groups.pop(key, (event, 0))
        groups[key] = (event, count + 1)
    return list(reversed(groups.values()))


def _when(stamp_ns: int, now_ns: int, took_off_ns: int | None) -> str:
    if took_off_ns is not None and stamp_ns >= took_off_ns:
        return clock_words((stamp_ns - took_off_ns) * 1e-9)
    return f"{age_words(max(0.0, (now_ns - stamp_ns) * 1e-9))} ago"
