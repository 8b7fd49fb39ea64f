"""Where the target was in the camera's image."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure as Canvas
from matplotlib.patches import Patch

from goshawk_dashboards.report.campaign.data import Campaign, Pair
from goshawk_dashboards.report.canvas import Figure, Palette, plain
from goshawk_dashboards.state.views import Array

BIN_PX = 8
COLUMNS = 4
KEY = (0.0625, 0.25, 0.5625, 1.0)
"""Parts of the greatest share that the key shows."""


def view_figure(campaign: Campaign) -> Figure | None:
    """A heat map for each cell; None if no path has a target."""
    pools = campaign.pools
    pixels = [pool.pixels for pool in pools]
    if not any(pixels):
        return None
    size_px = campaign.file.image_px
    heats = [_heat(own, size_px) for own in pixels]
    most = max(float(heat.max()) for heat in heats) or 1.0
    rows = -(-len(pools) // COLUMNS)

    def draw(canvas: Canvas, palette: Palette) -> None:
        tiles = canvas.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True)
        for axes in tiles.flat[len(pools) :]:
            axes.set_visible(False)
        for axes, pool, heat in zip(tiles.flat, pools, heats, strict=False):
            _tile(axes, palette, heat, most, size_px)
            axes.set_title(f"{plain(pool.label)}: {100.0 * heat.sum():.0f} % inside")
        for axes in tiles[:, 0]:
            axes.set_ylabel("down, px")
        for axes in tiles.flat[max(len(pools) - COLUMNS, 0) : len(pools)]:
            axes.set_xlabel("to the right, px")
            axes.tick_params(axis="x", labelbottom=True)
        key = [Patch(facecolor=palette.vehicle, alpha=np.sqrt(k), label=f"{100.0 * k * most:.1f} %") for k in KEY]
        canvas.legend(handles=key, loc="outside upper right", ncols=len(KEY), title_fontsize=8.5)

    return Figure(
        name="view",
        title="Where the target was in the camera's image",
        caption="Its true centre, hidden or not, 20 times a second. "
        f"The stronger, the more of the time in those {BIN_PX} × {BIN_PX} px.",
        size_in=(10.0, 0.55 + rows * (2.2 * size_px[1] / size_px[0] + 0.55)),
        draw=draw,
        tables={},
    )


def _heat(pixels: list[Pair | None], size_px: tuple[int, int]) -> Array:
    """The share of all samples in each bin, rows downwards; what is outside the image or behind it is in none."""
    uv = np.array([pixel for pixel in pixels if pixel is not None], dtype=float).reshape(-1, 2)
    edges = [np.arange(0, size + BIN_PX, BIN_PX) for size in (size_px[1], size_px[0])]
    inside = (uv >= 0.0).all(axis=1) & (uv < size_px).all(axis=1)
    counts, *_ = np.histogram2d(uv[inside, 1], uv[inside, 0], bins=edges)
    return counts / max(len(pixels), 1)


def _tile(axes: Axes, palette: Palette, heat: Array, most: float, size_px: tuple[int, int]) -> None:
    rows, columns = np.nonzero(heat)
    corners_4 = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    squares = BIN_PX * (np.stack([columns, rows], axis=1)[:, None, :] + corners_4)
    # By its root, so that rare places show.
    axes.add_collection(
        PolyCollection(list(squares), facecolors=palette.vehicle, alpha=np.sqrt(heat[rows, columns] / most), lw=0)
    )
    axes.axvline(size_px[0] / 2, color=palette.soft, lw=0.8, ls=(0, (3, 3)))
    axes.axhline(size_px[1] / 2, color=palette.soft, lw=0.8, ls=(0, (3, 3)))
    axes.set_xlim(0, size_px[0])
    axes.set_ylim(size_px[1], 0)
    axes.set_xticks([0, size_px[0] / 2, size_px[0]])
    axes.set_yticks([0, size_px[1] / 2, size_px[1]])
    axes.set_aspect("equal")
    axes.grid(visible=False)
    for side in ("top", "right"):
        axes.spines[side].set_visible(True)
