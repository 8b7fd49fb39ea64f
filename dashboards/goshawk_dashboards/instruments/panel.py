"""The instrument panel: both estimates, and what the vehicle learns of itself, in numbers and over a stretch of time.

    track = Track()
    track.add(snap)                    # each new snapshot; or Track.of(snapshots) of a log
    panel_html(snap, track)

It brings its own ground and inks, so it looks the same on every page.
"""

from __future__ import annotations

from goshawk_dashboards.instruments.chart import Line, chart_svg
from goshawk_dashboards.instruments.disturbance import disturbance_charts, disturbance_html
from goshawk_dashboards.instruments.target import target_charts, target_html
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.html import TEXT, faded
from goshawk_dashboards.page.status import learnt_html
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array

WINDOW_S = 20.0


def panel_html(
    snap: Snapshot,
    track: Track,
    *,
    window_s: float = WINDOW_S,
    now_s: float | None = None,
) -> str:
    """``snap`` is the instant in numbers, ``track`` what the charts show, their times relative to its newest row.

    ``window_s``: how much of it, from its end. ``now_s``: an instant to mark, on the same scale (0 is the newest row).
    """
    time_S, columns = track.window(window_s)
    stale = not snap.fresh("control")
    return (
        f'<div data-goshawk="instruments" style="{TEXT};font-size:12px;background:{theme.css(theme.BACKGROUND)};'
        'padding:4px 10px;border-radius:6px">'
        + _part("Disturbance", faded(disturbance_html(snap, track), stale))
        + disturbance_charts(time_S, columns, now_s)
        + _part("Target filter", faded(target_html(snap), stale))
        + target_charts(time_S, columns, track.gate_sigmas, now_s)
        + _part("Learnt in flight", learnt_html(snap))
        + _learnt_charts(time_S, columns, now_s)
        + "</div>"
    )


def _part(title: str, body: str) -> str:
    return f'<div style="font-weight:600;color:#fff;margin:8px 0 4px;font-size:13px">{title}</div>{body}'


def _learnt_charts(time_S: Array, columns: dict[str, Array], now_s: float | None) -> str:
    def chart(title: str, name: str, least: float) -> str:
        line = Line(label=name, color=theme.VEHICLE, values_S=columns[name])
        return chart_svg(title, time_S, [line], least=least, now_s=now_s)

    return chart("hover thrust, % of full", "hover", 10.0) + chart("attitude lag, ms", "lag", 20.0)
