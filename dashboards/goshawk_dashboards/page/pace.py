"""What keeps the 3-D view moving on a machine without a graphics card: a script of every page."""

from __future__ import annotations

from importlib.resources import files


def pace_html() -> str:
    """The script, which must run before viser's own."""
    return f"<script>\n{files('goshawk_dashboards.page').joinpath('pace.js').read_text(encoding='utf-8')}</script>"
