"""Writes a report."""

from __future__ import annotations

from pathlib import Path

from goshawk_dashboards.report.made import Report, make_report
from goshawk_dashboards.report.page import page

__all__ = ["Report", "make_report", "write_page"]


def write_page(report: Report, output: Path) -> None:
    """One HTML file that needs no network; what is no UTF-8 in it stands as an escape. Raises OSError."""
    output.write_text(page(report), encoding="utf-8", errors="backslashreplace")
