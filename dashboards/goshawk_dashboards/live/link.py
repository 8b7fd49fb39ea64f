"""What the panels say of the two ways to the vehicle: the link, and the autopilot's own telemetry radio."""

from __future__ import annotations

import math
from html import escape

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.html import DIM, NUM, faded, pill, table
from goshawk_dashboards.state.alerts import RADIO_STALE_S
from goshawk_dashboards.state.snapshot import STALE_S, Snapshot
from goshawk_dashboards.state.views import ChannelView

_CHANNELS = ("control", "plan", "map", "target", "health", "preview", "event", "sim_truth")


def _seconds(value: float | None) -> str:
    """Fine below a second; a dash for what is not known."""
    if value is None:
        return "&ndash;"
    if math.isinf(value):
        return "no answer"
    if value < 0.01:
        return f"{value * 1e3:.1f} ms"
    return f"{value * 1e3:.0f} ms" if value < 1.0 else f"{value:.1f} s"


def link_html(snap: Snapshot) -> str:
    """Each channel's rate, age, loss and bandwidth."""
    state = "linked" if snap.linked else "no link"
    color = theme.GOOD if snap.linked else theme.BAD
    figures = (
        ("last sample", _seconds(snap.heard_age_s)),
        ("round trip", _seconds(snap.round_trip_s)),
        ("from the vehicle", f"{sum(c.bytes_per_s for c in snap.channels if c.name != 'sim_truth') / 1000.0:.1f} kB/s"),
    )
    head = (
        f'<tr><td colspan="5" style="padding-bottom:4px">{pill(state, color)} <span style="{DIM}">'
        f"{escape(snap.endpoint)}</span></td></tr>"
        + '<tr><td colspan="5" style="padding-bottom:4px"><div style="display:flex;justify-content:space-between">'
        + "".join(
            f'<span><span style="{DIM};font-size:11px">{name}</span><br>{value}</span>' for name, value in figures
        )
        + "</div></td></tr>"
        f'<tr style="{DIM};font-size:11px"><td></td>'
        + "".join(f'<td style="{NUM}">{t}</td>' for t in ("Hz", "age", "loss", "kB/s"))
        + "</tr>"
    )
    by_name = {c.name: c for c in snap.channels}
    return table("link", head + "".join(_channel_row(by_name[n]) for n in _CHANNELS if n in by_name))


def _channel_row(c: ChannelView) -> str:
    if c.age_s is None and c.malformed == 0:
        return f'<tr style="{DIM}"><td>{escape(c.name)}</td><td colspan="4" style="{NUM}">nothing yet</td></tr>'
    # Events are rare by nature; nothing follows from their age.
    late = c.name != "event" and c.age_s is not None and c.age_s > STALE_S
    age = _seconds(c.age_s)
    loss = "&ndash;" if c.loss_fraction is None else f"{100 * c.loss_fraction:.1f} %"
    lossy = c.loss_fraction is not None and c.loss_fraction > 0.02
    bad = f' <span style="color:{theme.css(theme.BAD)}">{c.malformed} malformed</span>' if c.malformed else ""
    return (
        f"<tr><td>{escape(c.name)}{bad}</td>"
        f'<td style="{NUM}">{c.rate_hz:.1f}</td>'
        f'<td style="{NUM};{f"color:{theme.css(theme.BAD)}" if late else ""}">{age}</td>'
        f'<td style="{NUM};{f"color:{theme.css(theme.WARN)}" if lossy else ""}">{loss}</td>'
        f'<td style="{NUM}">{c.bytes_per_s / 1000:.1f}</td></tr>'
    )


def radio_html(snap: Snapshot) -> str:
    """The autopilot over its own radio: mode, battery, link. It is only listened to."""
    radio = snap.autopilot
    if radio is None:
        return ""
    silent = radio.age_s is None or radio.age_s > RADIO_STALE_S
    state = "not heard" if radio.age_s is None else ("SILENT" if silent else "heard")
    color = theme.BAD if silent else theme.GOOD
    rows = [("last heartbeat", _seconds(radio.age_s)), ("messages", f"{radio.rate_hz:.0f} Hz")]
    if radio.age_s is not None:
        rows.append(("mode", f"{escape(radio.mode)}, {'ARMED' if radio.armed else 'disarmed'}"))
    if radio.battery_fraction is not None or radio.battery_v is not None:
        share = "" if radio.battery_fraction is None else f"{100 * radio.battery_fraction:.0f} %"
        volts = "" if radio.battery_v is None else f"{radio.battery_v:.2f} V"
        rows.append(("battery", ", ".join(filter(None, (share, volts)))))
    if radio.loss_fraction is not None:
        rows.append(("loss", f"{100 * radio.loss_fraction:.1f} %"))
    if radio.radio_rssi is not None:
        rows.append(("signal here, remote", f"{radio.radio_rssi[0]}, {radio.radio_rssi[1]}"))
    if radio.trouble:
        rows.append(("trouble", escape(radio.trouble)))
    head = (
        f'<tr><td colspan="2" style="padding-bottom:4px">{pill(state, color)} <span style="{DIM}">'
        f"{escape(radio.source)}, read only</span></td></tr>"
    )
    body = "".join(f'<tr><td>{name}</td><td style="{NUM}">{value}</td></tr>' for name, value in rows)
    texts = "".join(
        f'<tr style="{DIM if severity == pb.SEVERITY_INFO else f"color:{theme.css(theme.WARN)}"}"><td colspan="2">'
        f"{escape(text)}</td></tr>"
        for severity, text in reversed(radio.texts[-4:])
    )
    return faded(table("radio", head + body + texts), silent)
