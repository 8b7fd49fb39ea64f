"""The charts of a report: what was flown over time, with its data in the page, zoomed together, offline."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np

from goshawk_dashboards.charts import script
from goshawk_dashboards.charts.clearance import Clearance
from goshawk_dashboards.charts.curves import drawn
from goshawk_dashboards.charts.derived import Series
from goshawk_dashboards.charts.signals import Signals, looks_of, unit_of
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.page import theme

COLUMNS = 500
"""Of a line: its least and greatest value in each."""
DIGITS = 4
CHARTS: Mapping[str, tuple[str, ...]] = {
    "Speed": ("speed", "target speed"),
    "Velocity": ("velocity east", "velocity north", "velocity up"),
    "Target": ("distance to target", "true distance to target"),
    "Clearance": ("true clearance", "clearance by depth"),
    **{
        f"Acceleration {axis}": tuple(
            f"{name} {axis}"
            for name in (
                "measured acceleration", "desired acceleration", "commanded acceleration", "disturbance",
                "true acceleration",
            )
        )
        for axis in ("east", "north", "up")
    },
    "Roll": ("roll", "roll asked"),
    "Pitch": ("pitch", "pitch asked"),
    "Yaw": ("yaw", "yaw asked"),
    "Attitude error": ("attitude error",),
    "Roll rate": ("roll rate", "roll rate asked"),
    "Pitch rate": ("pitch rate", "pitch rate asked"),
    "Yaw rate": ("yaw rate", "yaw rate asked"),
    "Thrust": ("thrust", "hover thrust", "least thrust", "most thrust"),
    "Battery": ("battery",),
    "Odometry's consistency": ("doubt of the odometry",),
    "Target filter's consistency": ("error of the target's place", "σ of the target's place"),
    "Cost of what was flown": ("cost flown",),
    "Age of what was flown": ("age of the plan",),
}  # fmt: skip
"""Title and signals. What was not logged is left out."""
_INKS = {
    theme.VEHICLE: "vehicle", theme.TARGET: "target", theme.GOOD: "up", theme.DISTURBANCE: "lost",
    theme.MEASURED: "soft", theme.TRUTH: "ink", theme.BAD: "north", theme.SECOND: "behind", theme.WARN: "too_close",
}  # fmt: skip
"""The page's palette, which follows the reader's theme, by the dashboards' colours."""


def over_time(flight: Flight, seen: Clearance | None, phase_colors: Mapping[str, str]) -> str:
    """The panel with all charts; empty if nothing was flown."""
    none: Series = (np.zeros(0), np.zeros(0))
    signals = Signals(flight, {"clearance by depth": none if seen is None else (seen.times_s_M, seen.nearest_m_M)})
    phases = flight.phases
    if not phases:
        return ""
    bounds = [phases[0].start_s, max(phases[-1].end_s, phases[0].start_s + 0.1)]
    charts = [
        {"title": title, "lines": lines}
        for title, names in CHARTS.items()
        if (lines := _lines(signals, names, bounds[0], bounds[1]))
    ]
    bands = [
        {"from_s": p.start_s, "to_s": p.end_s, "color": phase_colors.get(p.name, "#b3bac1")} for p in phases
    ]  # fmt: skip
    felt = np.isfinite(flight.columns("control", ["acc_meas_world"])["acc_meas_world"]).any()
    unfelt = "" if felt else " There was no IMU: no acceleration was measured."
    data = json.dumps({"bounds": bounds, "bands": bands, "charts": charts}, ensure_ascii=False, separators=(",", ":"))
    return (
        "<section class='panel' id='over-time'><h2>Over time</h2>"
        "<p class='soft'>A drag zooms all charts, a double-click shows the whole flight, a name hides its line. "
        f"Asked is what the controller sent; commanded what attitude and thrust alone would give.{unfelt}</p>"
        f"<div id='charts'></div></section>{script.styles()}"
        f'<script type="application/json" id="flown">{data.replace("<", chr(92) + "u003c")}</script>'
        f"{script.scripts('report', 'page.js')}"
    )


def _lines(signals: Signals, names: tuple[str, ...], from_s: float, to_s: float) -> list[dict[str, object]]:
    lines: list[dict[str, object]] = []
    for place, (name, (times_s, values)) in enumerate(signals.read(names).items()):
        t, v = drawn(times_s, values, from_s, to_s, COLUMNS)
        if not np.isfinite(v).any():
            continue
        rgb, dashed = looks_of(name, place)
        lines.append(
            {
                "key": name,
                "label": name,
                "unit": unit_of(name),
                "color": f"var(--{_INKS.get(rgb, 'ink')})",
                "dashed": dashed,
                "t": [round(x, 3) for x in t.tolist()],
                "v": [float(f"{x:.{DIGITS}g}") if np.isfinite(x) else None for x in v.tolist()],
            }
        )
    return lines
