"""What the panels' HTML is made of: fonts and inks, pills, tables."""

from __future__ import annotations

from html import escape

from goshawk_dashboards.page import theme

TEXT = "font:13px/1.45 system-ui,sans-serif;color:#d7dde6"
DIM = "color:#8b95a5"
TABLE = "width:100%;border-collapse:collapse;font:inherit;color:inherit"
NUM = "text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap"


def pill(text: str, color: theme.Rgb, size: int = 12) -> str:
    """A short word in a coloured frame; escaped."""
    return (
        f'<span style="display:inline-block;padding:2px 10px;border-radius:999px;font:600 {size}px/1.5 system-ui;'
        f'background:{theme.css(color, 0.18)};color:{theme.css(color)};border:1px solid {theme.css(color, 0.5)}">'
        f"{escape(text)}</span>"
    )


def faded(words: str, stale: bool) -> str:
    """HTML that is pale while it is stale."""
    return f'<div style="opacity:0.4">{words}</div>' if stale else words


def table(name: str, rows: str) -> str:
    """Rows of HTML as a table, which tests find by its name."""
    return (
        f'<div data-goshawk="{name}" style="{TEXT};padding:2px 12px">'
        f'<table style="width:100%;border-collapse:collapse">'
        f"{rows}</table></div>"
    )
