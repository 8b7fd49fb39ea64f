"""The colours of the timeline: of phases and of marks."""

from __future__ import annotations

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.page import theme

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


def phase_rgb(name: str) -> theme.Rgb:
    """A phase's colour."""
    return _PHASES.get(name, theme.STALE)
