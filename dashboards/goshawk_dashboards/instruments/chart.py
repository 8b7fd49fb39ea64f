"""One small chart as SVG: ticks, units, gaps where nothing is known, and a scale that a few knocks do not blow up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from goshawk_dashboards.page import theme
from goshawk_dashboards.state.views import Array

WIDTH, HEIGHT = 320, 112
LEFT, RIGHT, TOP, BOTTOM = 34, 6, 20, 18
INK, RULE = "#aab3c0", "#2a303b"
POINTS = 160
"""Drawn of each line at most: two pixels apart."""
GAP_S, GAP_STEPS = 1.5, 3.0
"""Between two values that are farther apart than this, and than so many usual steps, nothing is known: a line ends."""
ROBUST = (1.0, 99.0)
"""The scale holds what lies between these percentiles of a chart; what lies beyond is drawn at its edge."""
LEAST_SPAN, MOST = 1e-6, 1e12
"""An axis is at least so high, and reaches no farther than so much above and below 0."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Line:
    """One curve; NaN is a gap."""

    label: str
    color: theme.Rgb
    values_S: Array
    dashed: bool = False


def nice_step(span: float, most: int) -> float:
    """The least of 1, 2, 5, 10, 20 ... that divides a span into at most so many parts."""
    rough = span / most
    power = 10.0 ** math.floor(math.log10(rough))
    return next(k * power for k in (1.0, 2.0, 5.0, 10.0) if k * power >= rough * (1.0 - 1e-9))


def scale(lines: Sequence[Line], least: float, *, signed: bool) -> tuple[float, float, float]:
    """Bottom, top and step of the axis: 0 is always on it, and ``least`` is its least height above 0."""
    values = np.concatenate([line.values_S[np.isfinite(line.values_S)] for line in lines] or [np.zeros(0)])
    low, high = np.percentile(np.clip(values, -MOST, MOST), ROBUST) if len(values) else (0.0, 0.0)
    least = min(max(least, LEAST_SPAN), MOST)
    high = max(float(high), least)
    low = min(float(low), -least) if signed else 0.0
    step = nice_step(high - low, 4)
    return step * math.floor(low / step + 1e-9), step * math.ceil(high / step - 1e-9), step


def chart_svg(
    title: str, time_S: Array, lines: Sequence[Line], *, least: float, signed: bool = False, now_s: float | None = None
) -> str:
    """``time_S`` is s; ``least``: the axis is at least this high. ``now_s``: an instant to mark."""
    lines = [line for line in lines if np.isfinite(line.values_S).any()]
    low, high, step = scale(lines, least, signed=signed)
    first, last = (float(time_S[0]), float(time_S[-1])) if len(time_S) > 1 else (-1.0, 0.0)

    def x(t: Array) -> Array:
        return LEFT + (WIDTH - LEFT - RIGHT) * (t - first) / max(last - first, 1e-9)

    def y(v: Array) -> Array:
        return TOP + (HEIGHT - TOP - BOTTOM) * (high - np.clip(v, low, high)) / (high - low)

    ticks = [low + k * step for k in range(round((high - low) / step) + 1)]
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    parts = [_horizontal(float(y(np.array(v))), f"{v + 0.0:.{digits}f}", zero=abs(v) < 1e-9) for v in ticks]
    t_step = nice_step(max(last - first, 1e-3), 5)
    t_digits = max(0, -math.floor(math.log10(t_step) + 1e-9))
    parts += [
        _vertical(
            float(x(np.array(k * t_step))), f"{k * t_step:.{t_digits}f}{' s' if k * t_step > last - t_step else ''}"
        )
        for k in range(math.ceil(first / t_step - 1e-9), math.floor(last / t_step + 1e-9) + 1)
    ]
    keep = slice(None, None, max(1, math.ceil(len(time_S) / POINTS)))
    anew_S = _after_gap(time_S[keep])
    parts += [_path(x(time_S[keep]), y(line.values_S[keep]), anew_S, line) for line in lines]
    if now_s is not None:
        at = float(x(np.array(now_s)))
        parts.append(f'<path d="M{at:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="#fff" stroke-width="1"/>')
    empty = "" if lines else f'<text x="{WIDTH / 2}" y="{HEIGHT / 2}" text-anchor="middle">nothing to draw yet</text>'
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" style="display:block;width:100%" font-size="11" fill="{INK}" '
        f'font-family="system-ui,sans-serif"><text x="2" y="12" fill="#d7dde6" font-weight="600">{escape(title)}</text>'
        f"{''.join(parts)}{empty}</svg>"
    )


def _horizontal(y: float, label: str, *, zero: bool) -> str:
    return (
        f'<path d="M{LEFT} {y:.1f}H{WIDTH - RIGHT}" stroke="{"#566072" if zero else RULE}"/>'
        f'<text x="{LEFT - 4}" y="{y + 4:.1f}" text-anchor="end">{label}</text>'
    )


def _vertical(x: float, label: str) -> str:
    anchor = "end" if x > WIDTH - 24 else "middle"
    return (
        f'<path d="M{x:.1f} {TOP}V{HEIGHT - BOTTOM}" stroke="{RULE}"/>'
        f'<text x="{x:.1f}" y="{HEIGHT - 4}" text-anchor="{anchor}">{label}</text>'
    )


def _after_gap(time_S: Array) -> list[bool]:
    """Of each value whether nothing is known of the time before it."""
    steps_s = np.diff(time_S)
    usual_s = float(np.median(steps_s)) if len(steps_s) else 0.0
    return [True, *(steps_s > max(GAP_S, GAP_STEPS * usual_s)).tolist()][: len(time_S)]


def _path(x_S: Array, y_S: Array, anew_S: Sequence[bool], line: Line) -> str:
    """One path, begun anew after each gap."""
    words, pen = list[str](), "M"
    for x, y, anew in zip(x_S, y_S, anew_S, strict=True):
        if math.isfinite(y):
            words.append(f"{'M' if anew else pen}{x:.0f} {y:.1f}")
        pen = "L" if math.isfinite(y) else "M"
    dash = ' stroke-dasharray="3 3"' if line.dashed else ""
    return f'<path d="{"".join(words)}" fill="none" stroke="{theme.css(line.color)}" stroke-width="1.5"{dash}/>'
