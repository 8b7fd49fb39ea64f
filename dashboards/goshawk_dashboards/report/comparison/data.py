"""Cells that both pilots flew on the same seeds, and who is better in each by what."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from goshawk_dashboards.report.campaign.data import Campaign, CampaignError, Cell, Compute, load

LEARNED, CLASSICAL = "policy", "classical"
"""The pilots, as the simulator calls them."""
TIE = 0.01
"""Numbers that differ by less than this share of the greater are a tie."""
CLEARLY = 2
"""A pilot wins a metric if it is better in so many times the other's cells."""
FEWEST = 2
"""Of fewer flights nothing is claimed."""
WANTED = 1 / 3
"""Of the classical pilot's compute a plan, the learned pilot's is wanted to be no more than this."""
USUAL_M = 40.0
"""A course of this length is not worth a word."""


@dataclass(frozen=True, kw_only=True)
class Side:
    """One pilot's part of a pair."""

    cell: Cell
    compute: Compute | None
    """In the whole campaign; None: the file is older."""

    @property
    def successes(self) -> float:
        """%."""
        return 100.0 * self.cell.successes / max(self.cell.trials, 1)


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A cell that both pilots flew."""

    campaign: Campaign
    learned: Side
    classical: Side

    @property
    def sides(self) -> tuple[tuple[str, Side], ...]:
        """Both, by name."""
        return ("learned", self.learned), ("classical", self.classical)

    @property
    def place(self) -> str:
        """ "4 m, reactive, 120 m long, gusts of 5 m/s"."""
        cell = self.learned.cell
        longer = f"{cell.length_m:g} m long" if cell.length_m not in (None, USUAL_M) else ""
        gusts = f"gusts of {cell.wind_mps:g} m/s" if cell.wind_mps else ""
        return ", ".join(part for part in (cell.place, longer, gusts) if part)


def _interval(side: Side) -> tuple[float, float]:
    return side.cell.success_interval


def _time_s(side: Side) -> float | None:
    enough = (side.cell.reached or 0) >= FEWEST
    return side.cell.time_to_goal_s.p50 if enough and side.cell.time_to_goal_s else None


def _jerk(side: Side) -> float | None:
    return side.cell.jerk_integral_quantiles and side.cell.jerk_integral_quantiles.p50


def _in_view(side: Side) -> float | None:
    return None if side.cell.in_view_fraction is None else 100.0 * side.cell.in_view_fraction


@dataclass(frozen=True, kw_only=True)
class Metric:
    """By what pilots are compared."""

    name: str
    detail: str
    unit: str
    digits: int
    read: Callable[[Side], float | None]
    more: bool
    """Whether more is better."""
    of_campaign: bool = False
    """It is known of a whole campaign, not of a cell."""

    def value(self, side: Side) -> float | None:
        """None: nothing is claimed of it."""
        return self.read(side) if side.cell.trials >= FEWEST else None

    def better(self, pair: Pair) -> int | None:
        """1: the learned pilot is, -1: the classical one, 0: a tie; None: nothing is claimed."""
        a, b = self.value(pair.learned), self.value(pair.classical)
        if a is None or b is None:
            return None
        if self is SUCCESSES:
            (low_a, high_a), (low_b, high_b) = _interval(pair.learned), _interval(pair.classical)
            return int(low_a > high_b) - int(low_b > high_a)
        if abs(a - b) <= TIE * max(abs(a), abs(b)):
            return 0
        return 1 if (a > b) == self.more else -1


SUCCESSES = Metric(name="strict successes", detail="", unit="%", digits=0, read=lambda s: s.successes, more=True)
COMPUTE = Metric(
    name="compute", detail="mean of a plan", unit="ms", digits=2, more=False, of_campaign=True,
    read=lambda s: s.compute.total_ms.mean if s.compute else None,
)  # fmt: skip
METRICS = (
    SUCCESSES,
    Metric(name="time to goal", detail="median", unit="s", digits=1, read=_time_s, more=False),
    Metric(name="clearance", detail="5 %", unit="m", digits=2, read=lambda s: s.cell.clearance_m.p5, more=True),
    Metric(name="∫ jerk²", detail="median", unit="m²/s⁵", digits=0, read=_jerk, more=False),
    Metric(name="time in view", detail="mean", unit="%", digits=1, read=_in_view, more=True),
    COMPUTE,
)


@dataclass(frozen=True, kw_only=True)
class Score:
    """In how many cells, or campaigns, each pilot is better by a metric."""

    metric: Metric
    learned: int
    classical: int
    tied: int

    @property
    def winner(self) -> str:
        """Who is better in at least twice as many as the other; empty: neither."""
        if self.learned > 0 and self.learned >= CLEARLY * self.classical:
            return "learned"
        return "classical" if self.classical > 0 and self.classical >= CLEARLY * self.learned else ""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """All that is compared."""

    campaigns: tuple[Campaign, ...]
    pairs: tuple[Pair, ...]
    """Tracking first."""
    skipped: tuple[str, ...]
    """Files with nothing to compare, each with why."""

    def of(self, task: str) -> tuple[Pair, ...]:
        """A task's pairs."""
        return tuple(pair for pair in self.pairs if pair.learned.cell.task == task)

    def once(self) -> list[Pair]:
        """A pair of each campaign, for what is known of the whole campaign."""
        return list({id(pair.campaign): pair for pair in self.pairs}.values())

    @property
    def scores(self) -> list[Score]:
        """Of the metrics of which anything is known."""
        found: list[Score] = []
        for metric in METRICS:
            marks = [metric.better(pair) for pair in (self.once() if metric.of_campaign else self.pairs)]
            learned, classical, tied = (marks.count(mark) for mark in (1, -1, 0))
            if learned or classical or tied:
                found.append(Score(metric=metric, learned=learned, classical=classical, tied=tied))
        return found

    @property
    def compute_ratios(self) -> list[float]:
        """Learned over classical compute a plan, of each campaign that says it."""
        values = [(COMPUTE.value(pair.learned), COMPUTE.value(pair.classical)) for pair in self.once()]
        return [a / b for a, b in values if a is not None and b]


def compare(files: Iterable[Path], *, strict: bool = True) -> Comparison:
    """Raises `CampaignError`: nothing to compare, or a file is no campaign, which is skipped too unless `strict`."""
    campaigns: list[Campaign] = []
    pairs: list[Pair] = []
    skipped: list[str] = []
    for file in files:
        try:
            campaign = load(file)
        except CampaignError:
            if strict:
                raise
            skipped.append(f"{file.name} (unreadable)")
            continue
        found = _pairs(campaign)
        if campaign.file.rule and found:
            campaigns.append(campaign)
            pairs += found
        else:
            why = "one pilot" if campaign.file.rule else "an older rule"
            skipped.append(f"{file.name} ({why})")
    if not pairs:
        what = f"; skipped {', '.join(skipped)}" if skipped else ""
        raise CampaignError(f"nothing to compare: fly with --pilot policy,classical{what}")
    # False before True, otherwise in the order of the files
    pairs.sort(key=lambda pair: pair.learned.cell.task != "track")
    return Comparison(campaigns=tuple(campaigns), pairs=tuple(pairs), skipped=tuple(skipped))


def _pairs(campaign: Campaign) -> list[Pair]:
    computes = {compute.pilot: compute for compute in campaign.file.timing.compute}

    def sides(pilot: str) -> dict[Sequence[object], Side]:
        cells = [cell for cell in campaign.file.cells if cell.pilot == pilot]
        return {_conditions(cell): Side(cell=cell, compute=computes.get(pilot)) for cell in cells}

    classical = sides(CLASSICAL)
    return [
        Pair(campaign=campaign, learned=side, classical=classical[conditions])
        for conditions, side in sides(LEARNED).items()
        if conditions in classical
    ]


def _conditions(cell: Cell) -> tuple[object, ...]:
    """What both pilots must share: place, task, and the trials, which say the seeds."""
    place = (cell.task, cell.speed_mps, cell.spacing_m, cell.world, cell.evader, cell.course, cell.length_m)
    return (*place, cell.wind_mps, cell.moving, *(flight.trial for flight in cell.flights))
