"""Draws figures with matplotlib: SVG that follows the reader's light or dark theme, or PNG on white.

In SVG each colour of the palette is a placeholder that becomes a CSS variable of the page; text stays text.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from html import escape
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from goshawk_dashboards.log.phases import Phase

FONT = "DejaVu Sans"
"""What matplotlib measures text with; pages show their own font, which is narrower."""

HALF_IN = 4.9
"""Width of a figure of which two stand beside each other; a single one's is 10."""

Table = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Palette:
    """A colour for each meaning."""

    ink: str
    soft: str
    rule: str
    grid: str
    paper: str
    desired: str
    attitude: str
    disturbance: str
    measured: str
    east: str
    north: str
    up: str
    vehicle: str
    target: str
    solid: str
    success: str
    collision: str
    lost: str
    timeout: str
    too_close: str
    behind: str
    out_of_view: str
    slow: str


LIGHT = Palette(
    ink="#1c2126", soft="#5c6670", rule="#c9d0d6", grid="#e8ecef", paper="#ffffff",
    desired="#d98200", attitude="#d1383c", disturbance="#1c9650", measured="#2878c8",
    east="#2878c8", north="#d1383c", up="#1c9650", vehicle="#2878c8", target="#c4560b",
    solid="#a1978a", success="#2c9c86", collision="#cc4a06", lost="#7a55b5", timeout="#7d8790", too_close="#b8860b",
    behind="#9c3f86", out_of_view="#3f6fb0", slow="#7a8a1e",
)  # fmt: skip
DARK = Palette(
    ink="#e5e9ec", soft="#9aa5af", rule="#46505a", grid="#262d33", paper="#14181b",
    desired="#f5b040", attitude="#f26a6c", disturbance="#4fd08a", measured="#66b2f5",
    east="#66b2f5", north="#f26a6c", up="#4fd08a", vehicle="#66b2f5", target="#f5894a",
    solid="#756c60", success="#3aa990", collision="#f5894a", lost="#b095ea", timeout="#8d98a2", too_close="#e0b13c",
    behind="#d784c2", out_of_view="#7fa8e0", slow="#b6c455",
)  # fmt: skip
_NAMES = [field.name for field in fields(Palette)]
_PLACEHOLDERS = {name: f"#0102{k:02x}" for k, name in enumerate(_NAMES)}


def css_variables(palette: Palette) -> str:
    """The palette as declarations of CSS variables."""
    return " ".join(f"--{name}: {getattr(palette, name)};" for name in _NAMES)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure of a report."""

    name: str
    """As a file's stem: "velocity"."""
    title: str
    caption: str
    size_in: tuple[float, float]
    draw: Callable[[Canvas, Palette], None]
    tables: Mapping[str, Table]
    """What it shows: a name like its own → columns of one length each, units in their names."""


def svg(figure: Figure) -> str:
    """An <svg> element for a page that sets the palette's variables."""
    text = _saved(figure, Palette(**_PLACEHOLDERS), "svg").decode()
    text = text[text.index("<svg") :]
    for name, placeholder in _PLACEHOLDERS.items():
        text = text.replace(placeholder, f"var(--{name})")
    said = f'<svg role="img" aria-label="{escape(figure.title)}"'
    text = re.sub(r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', lambda m: f"{said} {m[1]}>", text, count=1)
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, count=1, flags=re.DOTALL)
    # Matplotlib names clip paths after their address in memory: the same log shall make the same page.
    order: dict[str, str] = {}
    text = re.sub(r"\bp[0-9a-f]{10}\b", lambda m: order.setdefault(m[0], f"clip{len(order)}"), text)
    # Several figures share a page, so an id needs its figure's name.
    text = re.sub(r'(id="|url\(#|xlink:href="#|href="#)', rf"\1{figure.name}-", text.replace("xlink:href", "href"))
    return text.replace(f"'{FONT}'", "inherit").replace(FONT, "inherit")


def plain(text: str) -> str:
    """For matplotlib, which takes what stands between dollars for mathematics."""
    return text.replace("$", r"\$")


def png(figure: Figure) -> bytes:
    """A picture on white, 150 dots an inch."""
    return _saved(figure, LIGHT, "png")


def write(figures: Sequence[Figure], folder: Path) -> list[Path]:
    """Each figure as PNG and what it shows as CSV, in a folder that is made if need be. Raises OSError."""
    folder.mkdir(parents=True, exist_ok=True)
    written: list[Path] = []
    for figure in figures:
        written.append(folder / f"{figure.name}.png")
        written[-1].write_bytes(png(figure))
        for name, table in figure.tables.items():
            written.append(folder / f"{name}.csv")
            with written[-1].open("w", newline="", encoding="utf-8") as file:
                rows = csv.writer(file)
                rows.writerow(table)
                rows.writerows(zip(*(column.tolist() for column in table.values()), strict=True))
    return written


def _saved(figure: Figure, palette: Palette, kind: str) -> bytes:
    settings: dict[Any, Any] = {
        "svg.fonttype": "none", "svg.hashsalt": figure.name, "font.family": FONT, "font.size": 9.0,
        "text.color": palette.ink, "axes.edgecolor": palette.rule, "axes.labelcolor": palette.soft,
        "xtick.color": palette.rule, "ytick.color": palette.rule, "xtick.labelcolor": palette.soft,
        "ytick.labelcolor": palette.soft, "axes.facecolor": "none", "axes.grid": True, "grid.color": palette.grid,
        "axes.spines.top": False, "axes.spines.right": False, "axes.axisbelow": True, "legend.frameon": False,
        "legend.fontsize": 8.5, "lines.linewidth": 1.3, "axes.titlesize": 9.0, "axes.titlelocation": "left",
        "axes.titlecolor": palette.soft, "grid.linewidth": 0.8, "axes.formatter.use_mathtext": False,
        "axes.unicode_minus": True,
    }  # fmt: skip
    with mpl.rc_context(settings):
        canvas = Canvas(
            figsize=figure.size_in, layout="constrained", facecolor="none" if kind == "svg" else palette.paper
        )
        figure.draw(canvas, palette)
        out = io.BytesIO()
        metadata = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
        canvas.savefig(out, format=kind, dpi=150, metadata=metadata)
    return out.getvalue()


def mark_phases(axes: Axes, phases: Sequence[Phase], palette: Palette, *, named: bool) -> None:
    """A line where each phase begins, and its name above where there is room. None: the controller's steps are lost."""
    if not phases:
        return
    start_s, end_s = phases[0].start_s, phases[-1].end_s
    for phase in phases:
        if phase.duration_s > 0.005 * (end_s - start_s):
            axes.axvline(phase.start_s, color=palette.soft, lw=0.8, ls=(0, (2, 3)))
        if named and phase.duration_s > 0.012 * len(phase.name) * (end_s - start_s):
            middle_s = (phase.start_s + phase.end_s) / 2
            at: dict[str, Any] = {
                "xytext": (0, 3), "textcoords": "offset points", "xycoords": ("data", "axes fraction"),
            }  # fmt: skip
            axes.annotate(phase.name, (middle_s, 1.0), ha="center", va="bottom", fontsize=8, color=palette.soft, **at)
    axes.set_xlim(start_s, end_s)


def legend(axes: Axes, columns: int) -> None:
    """Above the axes, at the right."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.06), ncols=columns, borderaxespad=0.0, columnspacing=1.2)


def columns_of(prefix: str, values_M3: NDArray[Any], unit: str) -> dict[str, NDArray[Any]]:
    """A vector's columns: "vel_east_mps" …"""
    return {f"{prefix}_{axis}_{unit}": np.asarray(values_M3)[:, k] for k, axis in enumerate(("east", "north", "up"))}
