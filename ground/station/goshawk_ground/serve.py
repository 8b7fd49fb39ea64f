"""Puts a link and the live dashboard together."""

from __future__ import annotations

from goshawk_dashboards.live import LiveDashboard

from goshawk_ground.link import GroundLink


def serve_dashboard(link: GroundLink, *, host: str, port: int) -> LiveDashboard:
    """A running dashboard of the link. Raises PortBusyError (an OSError) if the port is taken."""
    dashboard = LiveDashboard(host=host, port=port, latest=link.snapshot, on_start=link.start, on_stop=link.stop)
    dashboard.start()
    return dashboard
