"""What a review shows beside its scene, as HTML and SVG: pure functions. Every text from outside is escaped.

The plots are drawn once for a window of time. The cursor is an element of its own that lies over all of them, so that a
seek sends a few hundred bytes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.log.phases import Phase
from goshawk_dashboards.log.recorded import Mark
from goshawk_dashboards.page import theme
from goshawk_dashboards.review.plots import Curve, Plot

PLOT_PX = 68
TITLE_PX = 16
"""Of each plot, above its curves."""
BAND_PX = 26
AXIS_PX = 16
WIDTH = 1000.0
"""Of the drawings' own coordinates; the page stretches them."""

DIM = "#8b95a5"
DASHED = ' stroke-dasharray="4 3"'
FONT = "font:11px/16px system-ui,sans-serif;font-variant-numeric:tabular-nums"
_PHASES: dict[str, theme.Rgb] = {
    "on the ground": theme.STALE,
    "take-off": theme.VEHICLE,
    "tracking": theme.GOOD,
    "navigation": theme.GOOD,
    "lost": theme.TARGET,
    "search": theme.WARN,
    "hold": theme.DISTURBANCE,
    "landing": theme.VEHICLE,
    "landed": theme.STALE,
    "fault": theme.BAD,
}
MARK_COLORS: dict[pb.Severity, theme.Rgb] = {
    pb.SEVERITY_INFO: theme.TRUTH,
    pb.SEVERITY_WARNING: theme.WARN,
    pb.SEVERITY_ERROR: theme.BAD,
}


@dataclass(frozen=True, kw_only=True)
class Window:
    """The stretch of time that is drawn."""

    from_s: float
    to_s: float

    def x(self, time_s: float) -> float:
        """Where a time lies, 0 .. WIDTH within the window."""
        return WIDTH * (time_s - self.from_s) / (self.to_s - self.from_s)

    def share(self, time_s: float) -> float:
        """The same in per cent, never outside."""
        return min(max(self.x(time_s) / WIDTH * 100.0, 0.0), 100.0)

    @staticmethod
    def around(time_s: float, length_s: float | None, duration_s: float) -> Window:
        """The page of this length that holds a time; None: all of it."""
        whole_s = max(duration_s, 0.1)
        if length_s is None or length_s >= whole_s:
            return Window(from_s=0.0, to_s=whole_s)
        page = min(time_s // length_s, (whole_s - 1e-6) // length_s)
        return Window(from_s=page * length_s, to_s=(page + 1.0) * length_s)


def phase_rgb(name: str) -> theme.Rgb:
    """A phase's colour."""
    return _PHASES.get(name, theme.STALE)


def band_html(phases: Sequence[Phase], fallbacks: Sequence[Phase], marks: Sequence[Mark], window: Window) -> str:
    """The flight in one stripe: phases by colour, fallbacks red below, marks as ticks above, and its legend."""
    rects = _phase_rects(phases, window, 5, BAND_PX - 9, 0.75) + "".join(
        _rect(p, window, BAND_PX - 4, 4, theme.css(theme.BAD)) for p in fallbacks
    )
    ticks = "".join(
        f'<rect x="{window.x(m.time_s) - 1:.1f}" y="0" width="2.4" '
        f'height="{8 if m.severity == pb.SEVERITY_INFO else 14}" '
        f'fill="{theme.css(MARK_COLORS.get(m.severity, theme.TRUTH))}"/>'
        for m in marks
        if window.from_s <= m.time_s <= window.to_s
    )
    names = dict.fromkeys(p.name for p in phases)
    legend = "".join(
        f'<span style="margin-right:9px;white-space:nowrap"><span style="display:inline-block;width:9px;height:9px;'
        f'border-radius:2px;background:{theme.css(phase_rgb(n), 0.8)}"></span> {escape(n)}</span>'
        for n in names
    )
    return (
        f'<div data-goshawk="band" data-phases="{escape("|".join(p.name for p in phases))}" style="margin:0 10px">'
        f"{_svg(rects + ticks, BAND_PX)}"
        f'<div style="{FONT};color:#aab3c0;margin-top:2px">{legend}</div></div>'
    )


def band_cursor_html(time_s: float, window: Window) -> str:
    """The instant on the stripe; it lies over the element that follows."""
    return _over(_line(window.share(time_s), BAND_PX))


def plots_html(plots: Sequence[Plot], phases: Sequence[Phase], window: Window) -> str:
    """All plots above each other over one axis of time."""
    drawn = "".join(_plot_html(plot, phases, window) for plot in plots)
    ticks = "".join(
        f'<span style="position:absolute;left:{window.share(t):.2f}%;transform:translateX(-50%)">{t:g}</span>'
        for t in _round_times(window)
    )
    axis = f'<div style="position:relative;height:{AXIS_PX}px;{FONT};color:{DIM}">{ticks}</div>'
    return f'<div data-goshawk="plots" style="margin:0 10px">{drawn}{axis}</div>'


def cursor_html(plots: Sequence[Plot], time_s: float, window: Window) -> str:
    """The instant over all plots, with the values there; it lies over the element that follows."""
    height = PLOT_PX * len(plots)
    values = "".join(
        f'<div style="position:absolute;right:0;top:{k * PLOT_PX}px;{FONT}">{_values(plot, time_s)}</div>'
        for k, plot in enumerate(plots)
    )
    return _over(_line(window.share(time_s), height) + values, f'data-goshawk="cursor" data-time="{time_s:.3f}" ')


def _values(plot: Plot, time_s: float) -> str:
    # A dashed one lies over another, and there is no room.
    shown = ((c, c.at(time_s)) for c in plot.curves if not c.dashed)
    return "".join(
        f'<b style="margin-left:8px;font-weight:600;color:{theme.css(c.rgb)}">{v:.{plot.digits}f}</b>'
        for c, v in shown
        if v is not None
    )


def _over(content: str, attributes: str = "") -> str:
    style = "position:relative;height:0;margin:0 10px;z-index:2;pointer-events:none"
    return f'<div {attributes}style="{style}">{content}</div>'


def _line(share: float, height: int) -> str:
    return (
        f'<div style="position:absolute;left:{share:.3f}%;top:0;height:{height}px;'
        'border-left:1.5px solid #fff;opacity:0.85"></div>'
    )


def _plot_html(plot: Plot, phases: Sequence[Phase], window: Window) -> str:
    height = PLOT_PX - TITLE_PX - 4
    envelopes = [(c, c.envelope(window.from_s, window.to_s)) for c in plot.curves]
    low, high = _range(plot, [e for _, e in envelopes])
    lines = "".join(
        f'<path d="{_path(e, window, low, high, height)}" fill="none" stroke="{theme.css(c.rgb)}" stroke-width="1.3" '
        f'stroke-linejoin="round" vector-effect="non-scaling-stroke"{DASHED if c.dashed else ""}/>'
        for c, e in envelopes
    )
    zero_y = height * (high / (high - low))
    zero = (
        f'<rect x="0" y="{zero_y - 0.5:.1f}" width="{WIDTH:.0f}" height="1" fill="#3a4250"/>' if low < 0 < high else ""
    )
    back = _phase_rects(phases, window, 0, height, 0.1)
    legend = " ".join(f'<span style="color:{theme.css(c.rgb)}">{escape(c.label)}</span>' for c in _named(plot))
    scale = (
        f'<span style="position:absolute;left:2px;top:{TITLE_PX}px;color:{DIM};font-size:10px;line-height:11px">'
        f"{high:.{plot.digits}f}</span>"
        f'<span style="position:absolute;left:2px;bottom:4px;color:{DIM};font-size:10px;line-height:11px">'
        f"{low:.{plot.digits}f}</span>"
    )
    return (
        f'<div style="position:relative;height:{PLOT_PX}px;{FONT}">'
        f'<div style="height:{TITLE_PX}px;color:#aab3c0;white-space:nowrap;overflow:hidden">{escape(plot.title)} '
        f"{legend}</div>{_svg(back + zero + lines, height)}{scale}</div>"
    )


def _named(plot: Plot) -> list[Curve]:
    """The curves worth a name: where there are several of one flight."""
    own = [c for c in plot.curves if c.rgb != theme.SECOND and len(c.times_s)]
    return own if len(own) > 1 else []


def _range(plot: Plot, envelopes: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> tuple[float, float]:
    lows = [float(least.min()) for _, least, _ in envelopes if len(least)]
    highs = [float(most.max()) for _, _, most in envelopes if len(most)]
    if plot.from_zero:
        lows.append(0.0)
        highs.append(0.0)
    low, high = min(lows, default=0.0), max(highs, default=1.0)
    room = max(0.05 * (high - low), 0.5 * 10.0**-plot.digits)
    return (low - room if low < 0.0 else low), high + room


def _path(envelope: tuple[np.ndarray, ...], window: Window, low: float, high: float, height: float) -> str:
    times_s, least, most = envelope
    if len(times_s) == 0:
        return ""
    per = height / (high - low)
    gap_s = max(1.0, 3.0 * (window.to_s - window.from_s) / 340.0)
    parts: list[str] = []
    before_s = -np.inf
    for t, a, b in zip(times_s.tolist(), least.tolist(), most.tolist(), strict=True):
        x, y = window.x(t), (high - a) * per
        parts.append(f"{'M' if t - before_s > gap_s else 'L'}{x:.1f} {y:.1f}")
        if b - a > 1e-9:
            parts.append(f"L{x:.1f} {(high - b) * per:.1f}")
        before_s = t
    return "".join(parts)


def _phase_rects(phases: Sequence[Phase], window: Window, y: float, height: float, opacity: float) -> str:
    return "".join(_rect(p, window, y, height, theme.css(phase_rgb(p.name), opacity)) for p in phases)


def _rect(phase: Phase, window: Window, y: float, height: float, fill: str) -> str:
    left, right = max(0.0, window.x(phase.start_s)), min(WIDTH, window.x(phase.end_s))
    if right <= left:
        return ""
    return (
        f'<rect x="{left:.1f}" y="{y:g}" width="{max(right - left, 1.5):.1f}" height="{height:g}" fill="{fill}">'
        f"<title>{escape(phase.name)} {phase.start_s:.1f} to {phase.end_s:.1f} s</title></rect>"
    )


def _svg(content: str, height: float) -> str:
    return (
        f'<svg viewBox="0 0 {WIDTH:.0f} {height:g}" preserveAspectRatio="none" '
        f'style="display:block;width:100%;height:{height:g}px;background:#151a22;border-radius:3px">{content}</svg>'
    )


def _round_times(window: Window) -> list[float]:
    """Four to nine round times within the window, none at its very edges."""
    length_s = window.to_s - window.from_s
    step_s = next((s for s in (0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 120.0, 300.0) if length_s / s <= 8.0), 600.0)
    first, last = math.ceil(window.from_s / step_s), math.floor(window.to_s / step_s)
    times = (k * step_s for k in range(first, last + 1))
    return [t for t in times if 3.0 < window.share(t) < 97.0]
