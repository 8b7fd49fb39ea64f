"""One flight from above: what stood in its way, its path coloured by speed, and the target's."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Circle, PathPatch
from matplotlib.path import Path as Outline
from matplotlib.ticker import MaxNLocator

from goshawk_dashboards.exports.drawing import speed_colors_P3
from goshawk_dashboards.report.campaign.data import Campaign, FlightPath, FlightRow, Map, Pool
from goshawk_dashboards.report.canvas import HALF_IN, Figure, Palette, columns_of
from goshawk_dashboards.state.views import Array

SHADES = 12
"""Of speed."""
SIGHT_S = 2.0
"""A line from the vehicle to the target each."""
TICK = Outline([(-0.9, 0.0), (-0.25, -0.8), (1.0, 0.9)])


def map_figure(campaign: Campaign, pool: Pool, row: FlightRow, path: FlightPath, top_mps: float) -> Figure:
    """`top_mps`: where the shades of speed end."""
    (left_m, low_m), (right_m, high_m) = path.map.min_m, path.map.max_m

    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        axes.set_xlim(left_m, right_m)
        axes.set_ylim(low_m, high_m)
        axes.set_aspect("equal")
        axes.set_xlabel("east, m")
        axes.set_ylabel("north, m")
        axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        _surroundings(axes, palette, path.map)
        _paths(axes, palette, path, top_mps)
        axes.plot(*path.map.start_m, "o", mfc=palette.paper, mec=palette.ink, mew=1.6, ms=6.5)
        if path.map.goal_m is not None:
            axes.plot(*path.map.goal_m, "o", color=palette.ink, ms=6)
        _end(axes, palette, row)

    pos_S3, target_S3 = path.pos_S3, path.target_S3
    table = {
        "time_s": path.period_s * np.arange(len(pos_S3)),
        **columns_of("pos", pos_S3, "m"),
        "speed_mps": np.array(path.speed_mps),
        "clearance_m": np.array(path.clearance_m),
        **(columns_of("target", target_S3, "m") if len(target_S3) else {}),
    }
    name = f"flight-{pool.number}-{row.trial}"
    return Figure(
        name=name,
        title=f"Flight {pool.number}:{row.trial} from above: {row.ending}",
        caption="",
        size_in=(HALF_IN, 0.55 + (HALF_IN - 0.6) * (high_m - low_m) / (right_m - left_m)),
        draw=draw,
        tables={name: table},
    )


def _surroundings(axes: Axes, palette: Palette, around: Map) -> None:
    if around.solids:
        # Holes lie inside their solids, turned the other way round: one path for all of them leaves them open.
        outlines = Outline.make_compound_path(*(Outline([*solid, solid[0]], closed=True) for solid in around.solids))
        axes.add_patch(PathPatch(outlines, facecolor=palette.solid, lw=0))
    for mover in around.movers:
        axes.plot(*np.transpose(mover.ends_m), color=palette.solid, lw=1.2, ls=(0, (4, 3)))
        axes.add_patch(Circle(mover.at_m, mover.radius_m, facecolor=palette.solid, lw=0))


def _paths(axes: Axes, palette: Palette, path: FlightPath, top_mps: float) -> None:
    pos_S3, target_S3 = path.pos_S3, path.target_S3
    if path.target is not None:
        every = max(round(SIGHT_S / path.period_s), 1)
        for own, other in zip(pos_S3[::every], target_S3[::every], strict=True):
            axes.plot([own[0], other[0]], [own[1], other[1]], color=palette.soft, lw=0.8, alpha=0.4)
        for begin, end in _runs(np.array(path.target.visible, dtype=int)):
            seen = path.target.visible[begin]
            look: dict[str, Any] = (
                {"color": palette.ink, "lw": 1.2} if seen else {"color": palette.soft, "lw": 1.2, "ls": (0, (1, 2))}
            )
            axes.plot(target_S3[begin : end + 1, 0], target_S3[begin : end + 1, 1], **look)
        axes.plot(*target_S3[-1, :2], "o", color=palette.ink, ms=5)
    shade_S = np.minimum(SHADES * np.array(path.speed_mps) / max(top_mps, 1e-9), SHADES - 1).astype(int)
    colors = speed_colors_P3((np.arange(SHADES) + 0.5) / SHADES, 1.0) / 255.0
    for begin, end in _runs(shade_S):
        axes.plot(
            pos_S3[begin : end + 1, 0], pos_S3[begin : end + 1, 1],
            color=tuple(colors[shade_S[begin]]), lw=2.6, solid_capstyle="round", solid_joinstyle="round",
        )  # fmt: skip


def _runs(kind_S: Array) -> Iterator[tuple[int, int]]:
    """First sample of each stretch of one kind, and the first after it, so that stretches join."""
    edges = [0, *(np.flatnonzero(np.diff(kind_S)) + 1).tolist(), len(kind_S)]
    return pairwise(edges) if len(kind_S) else iter(())


def _end(axes: Axes, palette: Palette, row: FlightRow) -> None:
    """A sign for each: colour is not all that tells outcomes apart."""
    signs = {"success": TICK, "collision": "x", "timeout": "_", "behind": "s", "out-of-view": "^", "slow": "D"}
    marker = signs.get(row.outcome, "o")
    color = getattr(palette, row.outcome.replace("-", "_"))
    for size in (11, 5) if row.outcome == "too-close" else (11,):
        axes.plot(*row.end_pos_m[:2], marker=marker, mfc="none", mec=color, mew=2.2, ms=size, zorder=5)
