"""The script that draws charts, to be put into a page: uPlot, ours around it, and a page's own after both."""

from __future__ import annotations

from importlib.resources import files


def styles(room: str = "", name: str = "") -> str:
    """A style element, with a page's own style last."""
    return (
        f"<style>\n{_read('charts', 'uplot/uPlot.min.css')}{_read('charts', 'charts.css')}{_read(room, name)}</style>"
    )


def scripts(room: str = "", name: str = "") -> str:
    """Script elements; a page's own comes last."""
    parts = (_read("charts", "uplot/uPlot.iife.min.js"), _read("charts", "charts.js"), _read(room, name))
    return "".join(f"<script>\n{part}</script>" for part in parts if part)


def _read(room: str, name: str) -> str:
    return files("goshawk_dashboards").joinpath(room, name).read_text(encoding="utf-8") if name else ""
