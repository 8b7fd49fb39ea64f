"""The contact sheet: some frames with their targets, depth beside them, and how often the data set shows what."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import numpy as np
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from goshawk_train.data.check.balance import Balance
from goshawk_train.data.check.poses import target_in_camera
from goshawk_train.data.check.report import Report
from goshawk_train.data.layout import Labels, View, read_images, read_labels
from goshawk_train.model import geometry

COLUMNS, ROWS = 4, 6
_FLAGGED = 8
_DEPTH_FAR_M = 12.0
_BODY_M = (0.55, 1.8)

_PAPER, _PANEL, _INK, _DIM = "#0f1216", "#171c22", "#e6e9ec", "#8b949e"
_GREEN, _AMBER, _RED, _BLUE = "#3ddc84", "#ffb454", "#ff5c57", "#5fb0ff"
_HEAT = LinearSegmentedColormap.from_list("heat", [_PANEL, "#1f5f8b", "#4cc3a5", "#ffe28a"])


@dataclass(frozen=True, kw_only=True)
class _Shot:
    """A frame on the sheet."""

    folder: Path
    frame: int
    flag: str


def _shots(report: Report) -> list[_Shot]:
    """Frames of which something is wrong first, a kind after the other; then frames from all over the data set."""
    readable = {scene.folder.name: scene for scene in report.scenes if scene.frames}
    flags: dict[tuple[str, int], list[str]] = {}
    seen = set[str]()
    for finding in report.errors:
        if finding.where in readable and (finding.frames or finding.kind == "map-disagrees"):
            place = (finding.where, finding.frames[0] if finding.frames else 0)
            if finding.kind not in seen or place in flags:
                flags.setdefault(place, []).append(finding.kind)
            seen.add(finding.kind)
    shots = [
        _Shot(folder=readable[where].folder, frame=frame, flag=", ".join(kinds[:2]) + (" .." if kinds[2:] else ""))
        for (where, frame), kinds in list(flags.items())[:_FLAGGED]
    ]
    rng = np.random.default_rng(0)
    scenes = list(readable.values())
    wanted = COLUMNS * ROWS - len(shots)
    for place_of in np.linspace(0, len(scenes) - 1, wanted).round() if scenes else ():
        scene = scenes[int(place_of)]
        shown = np.flatnonzero(scene.balance.shown_F) if scene.balance else np.zeros(0, dtype=np.int64)
        pool: NDArray[np.int64] = shown if len(shown) and rng.uniform() < 0.8 else np.arange(scene.frames)
        fresh = [f for f in pool.tolist() if (scene.folder.name, f) not in flags]
        if fresh:
            frame = int(rng.choice(fresh))
            flags[(scene.folder.name, frame)] = []
            shots.append(_Shot(folder=scene.folder, frame=frame, flag=""))
    return shots


def draw(report: Report, out: Path) -> None:
    """Write the PNG. Raises `OSError` if it cannot be written."""
    shots = _shots(report)
    rows = max(-(-len(shots) // COLUMNS), 1)
    style: dict[Any, Any] = {"font.family": "DejaVu Sans", "text.color": _INK, "axes.edgecolor": "#2b323b"}
    style |= {"xtick.color": _DIM, "ytick.color": _DIM, "axes.labelcolor": _DIM, "font.size": 9}
    with pyplot.rc_context(style):
        height = 1.2 + 1.45 * rows + 3.0
        figure = pyplot.figure(figsize=(17, height), facecolor=_PAPER)
        _header(figure, report, height)
        top, bottom = 1 - 1.2 / height, 3.0 / height
        grid = figure.add_gridspec(
            rows, COLUMNS, left=0.02, right=0.98, top=top, bottom=bottom, wspace=0.04, hspace=0.2
        )
        for number, shot in enumerate(shots):
            _frame(figure.add_subplot(grid[number // COLUMNS, number % COLUMNS]), shot, report.view)
        if report.balance:
            panels = figure.add_gridspec(
                1, 5, left=0.045, right=0.98, top=2.35 / height, bottom=0.55 / height, wspace=0.26
            )
            _histograms([figure.add_subplot(panels[0, i]) for i in range(5)], report, report.balance)
        out.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(out, format="png", dpi=100, facecolor=_PAPER)
        pyplot.close(figure)


def _header(figure: Figure, report: Report, height: float) -> None:
    errors = len(report.errors)
    warnings = len(report.findings) - errors
    y = 1 - 0.42 / height
    figure.text(0.02, y, report.root.resolve().name, fontsize=22, weight="bold", va="center")
    text = f"{len(report.scenes)} scenes · {report.frames:,} frames".replace(",", " ")
    figures = report.figures()
    if report.balance:
        text += f" · {100 * figures['target_shown']:.0f} % show the target"
    if "map_median_m" in figures:
        text += f" · depth within {100 * figures['map_median_m']:.0f} cm of the map (median)"
    figure.text(0.02, 1 - 0.76 / height, text, fontsize=11, color=_DIM, va="center")
    verdict, colour = ("fit to train on", _GREEN) if not errors else (f"{errors} errors", _RED)
    if warnings:
        verdict += f" · {warnings} warning{'s' if warnings > 1 else ''}"
    figure.text(0.98, y, verdict, fontsize=15, weight="bold", color=colour, ha="right", va="center")
    key = ((0.83, "target in view", _GREEN), (0.925, "partly hidden", _AMBER), (0.98, "hidden", _RED))
    for x, name, tint in key:
        figure.text(x, 1 - 0.76 / height, f"▢ {name}", fontsize=10, color=tint, ha="right", va="center")


def _false_colour(depth_HW: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Near is bright, far is dark, no measurement the panel's grey."""
    metres = depth_HW.astype(np.float64) / 1000
    rgba = matplotlib.colormaps["magma"](1 - 0.9 * np.clip(metres / _DEPTH_FAR_M, 0, 1))
    rgba[depth_HW == 0] = to_rgba("#20262d")
    return (rgba[..., :3] * 255).astype(np.uint8)


def _frame(axes: Axes, shot: _Shot, view: View) -> None:
    labels = read_labels(shot.folder / "labels.csv", 0)
    rgb, depth = read_images(shot.folder, len(labels), view)
    gap = np.full((view.height, 3, 3), 15, dtype=np.uint8)
    pair = np.hstack([rgb[shot.frame], gap, _false_colour(np.asarray(depth[shot.frame]))])
    axes.imshow(pair, interpolation="nearest", extent=(0, pair.shape[1], view.height, 0))
    axes.set(xticks=[], yticks=[], autoscale_on=False)
    for spine in axes.spines.values():
        spine.set(color=_RED if shot.flag else _PAPER, linewidth=2 if shot.flag else 0)
    caption = f"{shot.folder.name} · {shot.frame}"
    about_target = _target(axes, labels, shot.frame, view)
    caption += "" if shot.flag else about_target  # the flag needs the room
    axes.set_title(caption, fontsize=8, color=_DIM, loc="left", pad=3)
    if shot.flag:
        axes.set_title(shot.flag, fontsize=8.5, color=_RED, loc="right", pad=3, weight="bold")


def _target(axes: Axes, labels: Labels, frame: int, view: View) -> str:
    """Draw the target's box into both images; returns what the caption says of it."""
    if not labels.has_target_F[frame]:
        return " · no target"
    pos_cam, visible = target_in_camera(labels)[frame], labels.visible_F[frame]
    text = f" · {np.linalg.norm(pos_cam):.1f} m, {100 * visible:.0f} % visible"
    if pos_cam[0] < 0.2:
        return text
    u, v = (float(c) for c in geometry.project(pos_cam, view))
    colour = _GREEN if visible >= 0.8 else _AMBER if visible >= 0.2 else _RED
    wide, high = (size * view.focal_px / float(pos_cam[0]) for size in _BODY_M)
    for offset in (0, view.width + 3):
        box = Rectangle((offset, 0), view.width, view.height, transform=axes.transData)
        corner = (offset + u - wide / 2, v - high / 2)
        style: dict[str, Any] = {"fill": False, "edgecolor": colour, "linewidth": 1.3, "clip_on": True}
        mark = axes.add_patch(Rectangle(corner, wide, high, **style))
        mark.set_clip_path(box)
        cross = axes.plot(offset + u, v, "+", color=colour, markersize=5, markeredgewidth=1.0)[0]
        cross.set_clip_path(box)
    return text


def _histograms(axes: list[Axes], report: Report, balance: Balance) -> None:
    for panel in axes:
        panel.set_facecolor(_PANEL)
        panel.spines[["top", "right"]].set_visible(False)
        panel.tick_params(length=0)
    _bars(axes[0], balance.distance_F[balance.shown_F], np.arange(0.0, 20.5, 1.0), "target's distance, m", _GREEN)
    box = (0, report.view.width, report.view.height, 0)
    axes[1].imshow(balance.image_counts(), cmap=_HEAT, extent=box, interpolation="nearest", vmin=0)
    axes[1].set_title("target's place in the image", fontsize=10, color=_INK, loc="left")
    axes[1].set(xticks=[], yticks=[])
    _bars(axes[2], balance.height_F, np.arange(0, 6.1, 0.25), "height above ground, m", _BLUE)
    _bars(axes[3], balance.pitch_F, np.arange(-60.0, 61.0, 5.0), "camera's pitch, deg (up +)", _BLUE)
    known = [s.agreement.score for s in report.scenes if s.agreement]
    _bars(axes[4], 100 * np.array(known), np.arange(0.0, 101.0, 4.0), "agreement with the map, % (scenes)", _AMBER)


def _bars(axes: Axes, values: NDArray[np.float64], edges: NDArray[np.float64], title: str, colour: str) -> None:
    axes.hist(np.clip(values, edges[0], edges[-1] - 1e-6), bins=list(edges), color=colour, rwidth=0.86)
    axes.set_title(title, fontsize=10, color=_INK, loc="left")
    axes.set_yticks([])
    axes.set_xlim(edges[0], edges[-1])
