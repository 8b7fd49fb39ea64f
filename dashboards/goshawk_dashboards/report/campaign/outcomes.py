"""How often flights succeeded, and why they did not."""

from __future__ import annotations

from typing import Any

from matplotlib.figure import Figure as Canvas

from goshawk_dashboards.report.campaign.data import OUTCOMES, Campaign, Pool
from goshawk_dashboards.report.campaign.tables import cells_table, flights_table
from goshawk_dashboards.report.canvas import HALF_IN, Figure, Palette, legend, plain

SERIES = ("vehicle", "target", "up", "lost", "desired", "soft")
"""Colours of the palette, one a series; signs differ too: colour is not all that tells series apart."""
MARKERS = "os^Dv*"
MOST_TICKS = 10


def success_figure(campaign: Campaign) -> Figure:
    """Success against speed, a line for each kind of place."""
    places: dict[str, list[Pool]] = {}
    for pool in sorted(campaign.pools, key=lambda p: p.cell.speed_mps):
        places.setdefault(pool.cell.place, []).append(pool)
    speeds = sorted({pool.cell.speed_mps for pool in campaign.pools})
    span_mps = max(speeds[-1] - speeds[0], 1.0)

    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        for series, pools in enumerate(places.values()):
            color = getattr(palette, SERIES[series % len(SERIES)])
            # Side by side, so that no interval hides another.
            aside = 0.018 * span_mps * (series - 0.5 * (len(places) - 1))
            at = [pool.cell.speed_mps + aside for pool in pools]
            share = [100.0 * pool.cell.successes / max(pool.cell.trials, 1) for pool in pools]
            low, high = ([100.0 * pool.cell.success_interval[k] for pool in pools] for k in (0, 1))
            # At the ends of the scale an interval's edge may lie a rounding beyond the share.
            reach = [[max(s - x, 0.0) for s, x in zip(share, low, strict=True)],
                     [max(x - s, 0.0) for s, x in zip(share, high, strict=True)]]  # fmt: skip
            look: dict[str, Any] = {
                "fmt": f"{MARKERS[series % len(MARKERS)]}-",
                "capsize": 3,
                "ms": 5,
                "lw": 1.6,
                "elinewidth": 1.1,
            }
            axes.errorbar(at, share, yerr=reach, color=color, mec=palette.paper, label=_words(pools[0]), **look)
            if len(places) == 1:
                for pool, x, y in zip(pools, at, share, strict=True):
                    words = f"{pool.cell.successes}/{pool.cell.trials}"
                    axes.annotate(words, (x, y), (7, -12), textcoords="offset points", color=palette.ink)
        axes.set_ylim(0.0, 104.0)
        axes.set_xlim(speeds[0] - 0.12 * span_mps, speeds[-1] + 0.16 * span_mps)
        if len(speeds) <= MOST_TICKS:
            axes.set_xticks(speeds, [f"{speed:g}" for speed in speeds])
        axes.set_ylabel("flights that succeeded, %")
        axes.set_xlabel("target's speed, m/s" if campaign.tracks else "asked speed, m/s")
        legend(axes, 2)

    return Figure(
        name="success",
        title="Success against speed",
        caption="With the 95 % interval of the rate (Wilson).",
        size_in=(HALF_IN, 3.1 + 0.2 * ((len(places) - 1) // 2)),
        draw=draw,
        tables={"cells": cells_table(campaign)},
    )


def _words(pool: Pool) -> str:
    return plain(f"a tree every {pool.where}" if pool.where.endswith(" m") else pool.where)


def endings_figure(campaign: Campaign) -> Figure:
    """Outcomes of each cell, stacked."""
    pools = campaign.pools
    found = [outcome for outcome in OUTCOMES if any(pool.cell.count(outcome) for pool in pools)]

    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        rows = range(len(pools))
        left = [0.0] * len(pools)
        for outcome in found:
            color = getattr(palette, outcome.replace("-", "_"))
            counts = [pool.cell.count(outcome) for pool in pools]
            shares = [100.0 * n / max(pool.cell.trials, 1) for n, pool in zip(counts, pools, strict=True)]
            alpha = 0.35 if outcome == "success" else 1.0
            axes.barh(rows, shares, left=left, height=0.72, color=color, alpha=alpha, label=outcome.replace("-", " "))
            for row, (count, share) in enumerate(zip(counts, shares, strict=True)):
                if share > 4.0:
                    ink = palette.ink if outcome == "success" else palette.paper
                    place = left[row] + share / 2
                    axes.text(place, row, str(count), ha="center", va="center", fontsize=8.5, color=ink)
            left = [a + b for a, b in zip(left, shares, strict=True)]
        axes.set_yticks(rows, [plain(pool.label) for pool in pools])
        axes.tick_params(axis="y", length=0, labelcolor=palette.ink)
        # A single bar is no wall.
        axes.set_ylim(max(len(pools), 4) - 0.5, -0.5)
        axes.set_xlim(0.0, 100.0)
        axes.grid(visible=False, axis="y")
        axes.set_xlabel("share of the flights, %")
        legend(axes, len(found))

    return Figure(
        name="endings",
        title="How the flights ended",
        caption="In each cell; the numbers count flights.",
        size_in=(HALF_IN, max(3.1, 0.9 + 0.27 * len(pools))),
        draw=draw,
        tables={"flights": flights_table(campaign)},
    )
