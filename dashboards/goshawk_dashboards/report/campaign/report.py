"""Puts a campaign's page together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from goshawk_dashboards.report.campaign.data import Campaign, FlightRow, Pool
from goshawk_dashboards.report.campaign.distributions import distribution_figures
from goshawk_dashboards.report.campaign.maps import map_figure
from goshawk_dashboards.report.campaign.outcomes import endings_figure, success_figure
from goshawk_dashboards.report.campaign.view import view_figure
from goshawk_dashboards.report.canvas import Figure

FAILURES = 24
"""So many failures are shown at most, the first of each cell before the second of any."""
SUCCESSES, SUCCESSES_OF_CELL = 16, 2
"""And so many successes, in all and of each cell; none of a file without paths."""


@dataclass(frozen=True, kw_only=True)
class Shown:
    """One flight on the page."""

    pool: Pool
    row: FlightRow
    map: Figure | None
    """None if the file has no paths."""


@dataclass(frozen=True, kw_only=True)
class CampaignReport:
    """A campaign, worked out."""

    campaign: Campaign
    outcomes: tuple[Figure, ...]
    view: Figure | None
    distributions: tuple[Figure, ...]
    failed: tuple[Shown, ...]
    succeeded: tuple[Shown, ...]
    more: tuple[str, ...]
    """Failures for which there was no room, as `--only` names them."""
    top_mps: float
    """Where the maps' shades of speed end."""

    @property
    def figures(self) -> list[Figure]:
        """All of them, in the order of reading."""
        maps = [shown.map for shown in (*self.failed, *self.succeeded)]
        return [f for f in (*self.outcomes, self.view, *self.distributions, *maps) if f is not None]


def make_campaign_report(campaign: Campaign) -> CampaignReport:
    """Chooses and works out what to draw."""
    failed, more = _first(campaign, None, FAILURES, lambda f: f.outcome != "success")
    succeeded, _ = _first(campaign, SUCCESSES_OF_CELL, SUCCESSES, lambda f: f.outcome == "success")
    chosen = [*failed, *succeeded]
    tops = [max(pool.paths[row.trial].speed_mps, default=0.0) for pool, row in chosen if row.trial in pool.paths]
    top_mps = max(tops, default=0.0)

    def shown(pool: Pool, row: FlightRow) -> Shown:
        path = pool.paths.get(row.trial)
        figure = None if path is None else map_figure(campaign, pool, row, path, top_mps)
        return Shown(pool=pool, row=row, map=figure)

    return CampaignReport(
        campaign=campaign,
        outcomes=(success_figure(campaign), endings_figure(campaign)),
        view=view_figure(campaign),
        distributions=tuple(distribution_figures(campaign)),
        failed=tuple(shown(pool, row) for pool, row in failed),
        succeeded=tuple(shown(pool, row) for pool, row in succeeded if row.trial in pool.paths),
        more=tuple(f"{pool.number}:{row.trial}" for pool, row in more),
        top_mps=top_mps,
    )


Places = list[tuple[Pool, FlightRow]]


def _first(
    campaign: Campaign, of_cell: int | None, room: int, kind: Callable[[FlightRow], bool]
) -> tuple[Places, Places]:
    """Up to `room` flights of a kind, no more than `of_cell` of each cell, and those for which there was no room."""
    ranked: list[tuple[int, int, int]] = []
    for place, pool in enumerate(campaign.pools):
        own = [index for index, flight in enumerate(pool.cell.flights) if kind(flight)]
        ranked += [(rank, place, index) for rank, index in enumerate(own[:of_cell])]
    ranked.sort()

    def found(part: Sequence[tuple[int, int, int]]) -> Places:
        places = sorted((place, index) for _, place, index in part)
        return [(campaign.pools[place], campaign.pools[place].cell.flights[index]) for place, index in places]

    return found(ranked[:room]), found(ranked[room:])
