"""The dock below a review's scene: timeline and charts. Its script comes with the page and talks with the desk."""

from __future__ import annotations

from goshawk_dashboards.charts import script


def foot_html() -> str:
    """Styles and scripts, at the end of viser's page."""
    return script.styles("review", "dock.css") + script.scripts("review", "dock.js")


def seat_html(client_id: int) -> str:
    """Tells the script which viser client its browser is."""
    return f'<div data-viewer="{client_id}"></div>'
