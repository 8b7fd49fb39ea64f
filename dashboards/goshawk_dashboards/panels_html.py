"""What the panels say, as HTML: pure functions of a snapshot. Every text from outside is escaped."""

from __future__ import annotations

from html import escape

import numpy as np

from goshawk_dashboards import theme
from goshawk_dashboards.snapshot import ChannelView, Snapshot

STALE_S = 1.5
"""A vehicle not heard for this long is shown as stale: three times the heartbeat's period, and the link's lease is
2 s."""

_MODE_COLORS: dict[str, theme.Rgb] = {
    "idle": theme.STALE,
    "ready": theme.GOOD,
    "takeoff": theme.VEHICLE,
    "track": theme.GOOD,
    "navigate": theme.GOOD,
    "search": theme.WARN,
    "hold": theme.VEHICLE,
    "stopping": theme.WARN,
    "landed": theme.VEHICLE,
    "fault": theme.BAD,
}

_TEXT = "font:13px/1.45 system-ui,sans-serif;color:#d7dde6"
_DIM = "color:#8b95a5"
_NUM = "text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap"
_MARKS = {True: "&#10003;", False: "&#10007;"}
_CHANNELS = ("control", "plan", "target", "health", "preview", "event", "sim_truth")


def heard_age_s(snap: Snapshot) -> float | None:
    """Seconds since anything at all came from the vehicle itself; None: nothing ever did."""
    ages = [c.age_s for c in snap.channels if c.name != "sim_truth" and c.age_s is not None]
    return min(ages) if ages else None


def is_stale(snap: Snapshot) -> bool:
    """Whether what is shown is no longer what is."""
    age_s = heard_age_s(snap)
    return age_s is None or age_s > STALE_S


def _pill(text: str, color: theme.Rgb, size: int = 12) -> str:
    return (
        f'<span style="display:inline-block;padding:2px 10px;border-radius:999px;font:600 {size}px/1.5 system-ui;'
        f'background:{theme.css(color, 0.18)};color:{theme.css(color)};border:1px solid {theme.css(color, 0.5)}">'
        f"{escape(text)}</span>"
    )


def status_html(snap: Snapshot) -> str:
    """The card at the top: vehicle, link, mode, and the numbers an operator glances at."""
    age_s = heard_age_s(snap)
    stale = is_stale(snap)
    mode = snap.mode
    if mode is None:
        link = "connected, waiting for telemetry" if snap.linked else f"no link to {snap.endpoint}: dialling"
        return (
            f'<div data-goshawk="status" style="{_TEXT};padding:10px 12px">{_pill("NO VEHICLE", theme.BAD, 15)}'
            f'<div style="{_DIM};margin-top:6px">{escape(snap.vehicle)}: {escape(link)}</div></div>'
        )
    color = theme.STALE if stale else _MODE_COLORS.get(mode, theme.WARN)
    head = _pill(mode.upper(), color, 16)
    if stale and age_s is not None:
        head += " " + _pill(f"STALE {age_s:.1f} s", theme.BAD, 13)
    elif not snap.alive:
        head += " " + _pill("not alive", theme.WARN)
    control = snap.control
    if control is not None and control.fallback != "none":
        head += (
            f'<div style="margin-top:6px">{_pill("fallback: " + control.fallback.replace("_", " "), theme.BAD)}</div>'
        )
    health = snap.health
    faults = "".join(
        f'<div style="color:{theme.css(theme.BAD)};margin-top:4px">&#9888; {escape(f)}</div>'
        for f in (health.faults if health is not None else ())
    )
    return (
        f'<div data-goshawk="status" data-mode="{escape(mode)}" data-stale="{str(stale).lower()}" '
        f'style="{_TEXT};padding:10px 12px 4px">'
        f'<div style="display:flex;justify-content:space-between;align-items:center"><div>{head}</div>'
        f'<div style="text-align:right;{_DIM}"><b style="color:#fff">{escape(snap.vehicle)}</b><br>'
        f"{escape(health.autopilot if health is not None else '')}</div></div>"
        f"{faults}{_faded(_figures(snap), stale)}</div>"
    )


def _figures(snap: Snapshot) -> str:
    control, target, health, truth = snap.control, snap.target, snap.health, snap.truth
    cells: list[tuple[str, str]] = []
    if control is not None:
        cells.append(("speed", f"{float(np.linalg.norm(control.vel_world_3)):.1f} m/s"))
        cells.append(("height", f"{control.pos_world_3[2]:.1f} m"))
    if control is not None and target is not None and target.confirmed:
        cells.append(("target", f"{float(np.linalg.norm(target.pos_world_3 - control.pos_world_3)):.1f} m"))
    else:
        cells.append(("target", "&ndash;"))
    if health is not None and health.battery_fraction is not None:
        cells.append(("battery", f"{100 * health.battery_fraction:.0f} %"))
    if truth is not None and snap.fresh("sim_truth", STALE_S):
        cells.append(("clearance", f"{truth.clearance_m:.2f} m"))
        cells.append(("target ran", f"{truth.target_path_m:.0f} m"))
    boxes = "".join(
        f'<div style="flex:1 0 29%;padding:4px 0"><div style="{_DIM};font-size:11px">{name}</div>'
        f'<div style="font-size:17px;font-weight:600;color:#fff;white-space:nowrap">{value}</div></div>'
        for name, value in cells
    )
    return f'<div style="display:flex;flex-wrap:wrap;margin-top:8px">{boxes}</div>'


def command_html(snap: Snapshot) -> str:
    """What became of the last command."""
    command = snap.command
    if command is None:
        return ""
    color = theme.GOOD if command.accepted else theme.BAD
    verdict = "accepted" if command.accepted else ("refused" if command.answered else "no reply")
    return (
        f'<div data-goshawk="command" style="{_TEXT};padding:0 12px 4px">'
        f'<b style="color:{theme.css(color)}">{escape(command.verb)} {verdict}</b> '
        f"<span>{escape(command.text)}</span></div>"
    )


def readiness_html(snap: Snapshot) -> str:
    """Each check with its reason, the failing ones first."""
    health = snap.health
    if health is None:
        return f'<div style="{_TEXT};{_DIM};padding:4px 12px">no heartbeat yet</div>'
    rows = "".join(
        f'<tr><td style="width:22px;color:{theme.css(theme.GOOD if c.ok else theme.BAD)}">{_MARKS[c.ok]}</td>'
        f'<td style="white-space:nowrap;padding-right:10px">{escape(c.name.replace("_", " "))}</td>'
        f'<td style="{_DIM if c.ok else "color:#fff"}">{escape(c.reason)}</td></tr>'
        for c in sorted(health.checks, key=lambda c: c.ok)
    )
    return _faded(_table("readiness", rows), is_stale(snap))


def failing_checks(snap: Snapshot) -> list[str]:
    """What is not ready, one line each; a silent vehicle is one of them."""
    if snap.health is None:
        return ["No heartbeat has come from the vehicle."]
    lines = [f"{c.name.replace('_', ' ')}: {c.reason}" for c in snap.health.checks if not c.ok]
    if is_stale(snap):
        lines.insert(0, "The vehicle is silent; what is shown here is old.")
    return lines


def link_html(snap: Snapshot) -> str:
    """Each channel's rate, age, loss and bandwidth."""
    state = "linked" if snap.linked else "no link"
    color = theme.GOOD if snap.linked else theme.BAD
    total = sum(c.bytes_per_s for c in snap.channels) / 1000.0
    head = (
        f'<tr><td colspan="5" style="padding-bottom:4px">{_pill(state, color)} <span style="{_DIM}">'
        f"{escape(snap.endpoint)}, {total:.1f} kB/s</span></td></tr>"
        f'<tr style="{_DIM};font-size:11px"><td></td>'
        + "".join(f'<td style="{_NUM}">{t}</td>' for t in ("Hz", "age", "loss", "kB/s"))
        + "</tr>"
    )
    by_name = {c.name: c for c in snap.channels}
    return _table("link", head + "".join(_channel_row(by_name[n]) for n in _CHANNELS if n in by_name))


def _channel_row(c: ChannelView) -> str:
    if c.age_s is None and c.malformed == 0:
        return f'<tr style="{_DIM}"><td>{escape(c.name)}</td><td colspan="4" style="{_NUM}">nothing yet</td></tr>'
    # Events are rare by nature; nothing follows from their age.
    late = c.name != "event" and c.age_s is not None and c.age_s > STALE_S
    age = "&ndash;" if c.age_s is None else (f"{c.age_s * 1e3:.0f} ms" if c.age_s < 1.0 else f"{c.age_s:.1f} s")
    loss = "&ndash;" if c.loss_fraction is None else f"{100 * c.loss_fraction:.1f} %"
    lossy = c.loss_fraction is not None and c.loss_fraction > 0.02
    bad = f' <span style="color:{theme.css(theme.BAD)}">{c.malformed} malformed</span>' if c.malformed else ""
    return (
        f"<tr><td>{escape(c.name)}{bad}</td>"
        f'<td style="{_NUM}">{c.rate_hz:.1f}</td>'
        f'<td style="{_NUM};{f"color:{theme.css(theme.BAD)}" if late else ""}">{age}</td>'
        f'<td style="{_NUM};{f"color:{theme.css(theme.WARN)}" if lossy else ""}">{loss}</td>'
        f'<td style="{_NUM}">{c.bytes_per_s / 1000:.1f}</td></tr>'
    )


def vehicle_html(snap: Snapshot) -> str:
    """What the heartbeat reports: rates, latencies, drops, versions."""
    health = snap.health
    if health is None:
        return f'<div style="{_TEXT};{_DIM};padding:4px 12px">no heartbeat yet</div>'
    rows = "".join(
        f'<tr><td>{escape(n.replace("_", " "))}</td><td colspan="3" style="{_NUM}">{hz:.1f} Hz</td></tr>'
        for n, hz in health.rates_hz
    )
    if health.latencies:
        rows += f'<tr style="{_DIM};font-size:11px"><td>latency, ms</td>' + "".join(
            f'<td style="{_NUM}">{t}</td>' for t in ("p50", "p99", "max")
        )
        rows += "</tr>" + "".join(
            f"<tr><td>{escape(x.name.replace('_', ' '))}</td>"
            + "".join(f'<td style="{_NUM}">{v:.2f}</td>' for v in (x.p50_ms, x.p99_ms, x.max_ms))
            + "</tr>"
            for x in health.latencies
        )
    rows += "".join(
        f'<tr style="color:{theme.css(theme.WARN)}"><td>{escape(n.replace("_", " "))} dropped</td>'
        f'<td colspan="3" style="{_NUM}">{count}</td></tr>'
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
        f'<tr style="{_DIM}"><td>{n}</td><td colspan="3" style="text-align:right;overflow-wrap:anywhere">'
        f"{escape(v)}</td></tr>"
        for n, v in facts
    )
    return _faded(_table("vehicle", rows), is_stale(snap))


def events_html(snap: Snapshot, newest: int = 12) -> str:
    """The newest events, newest first, by the vehicle's clock."""
    colors = {"warning": theme.css(theme.WARN), "error": theme.css(theme.BAD)}
    rows = "".join(
        f'<tr><td style="{_NUM};{_DIM};padding-right:8px">{e.stamp_ns * 1e-9:.1f} s</td>'
        f'<td style="color:{colors.get(e.severity, "inherit")}">{escape(e.text)}</td></tr>'
        for e in reversed(snap.events[-newest:])
    )
    return _table("events", rows or f'<tr><td style="{_DIM}">none yet</td></tr>')


def _faded(words: str, stale: bool) -> str:
    return f'<div style="opacity:0.4">{words}</div>' if stale else words


def _table(name: str, rows: str) -> str:
    return (
        f'<div data-goshawk="{name}" style="{_TEXT};padding:2px 12px">'
        f'<table style="width:100%;border-collapse:collapse">'
        f"{rows}</table></div>"
    )
