"""Two campaigns on the same seeds, flight by flight: who does better, by exact tests and intervals."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import duckdb

from goshawk_train.cluster.query import flights
from goshawk_train.cluster.store import Store
from goshawk_train.errors import TrainerError
from goshawk_train.rates import LEVEL, RateDifference, stats

RATES = {"success": "a success", "collision": "a collision"}
METRICS = {
    "clearance_m": "least clearance, m",
    "in_view_fraction": "share of time in view",
    "min_distance_to_target_m": "least distance to the target, m",
    "flown_speed_mean_mps": "mean speed, m/s",
    "jerk_integral": "∫ jerk² dt, m²/s⁵",
}
CELL = (
    *("row", "pilot", "task", "speed_mps", "spacing_m", "world"),
    *("evader", "course", "length_m", "wind_mps", "moving"),
)
"""What makes a cell the same in both. Its number does not: that depends on what else its row lists."""
PAIRS = """
select {columns}, a.trial as trial, a.seed as seed_a, b.seed as seed_b,
       a.outcome = 'success' as success_a, b.outcome = 'success' as success_b,
       a.outcome = 'collision' as collision_a, b.outcome = 'collision' as collision_b, {metrics}
from a join b on a.trial = b.trial and {same} order by a.row, a.cell, a.trial
"""
Cell = tuple[Any, ...]
"""The values of `CELL`."""


class PairedError(TrainerError):
    """The two cannot be compared; the message says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class MedianDifference:
    """How much a number is greater in B than in A, in the same flights."""

    what: str
    flights: int
    greater: int
    less: int
    median: float
    interval: tuple[float, float]
    """Of the median of the differences, from the order of the flights alone."""

    @property
    def p(self) -> float:
        """The sign test, exact, two-sided."""
        differ = self.greater + self.less
        return float(stats.binomtest(self.greater, differ).pvalue) if differ else 1.0


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A cell of both, or all of them."""

    name: str
    rates: list[RateDifference]
    medians: list[MedianDifference]
    only: str | None = None
    """The one that flew it, A or B, where the other did not: then it is left out."""


def compare(a: Store, b: Store) -> list[Compared]:
    """Cell by cell, then all together, then what one alone flew; raises `PairedError`."""
    connection = duckdb.connect()
    connection.register("a", flights(a))
    connection.register("b", flights(b))
    metrics = ", ".join(f"a.{name} as {name}_a, b.{name} as {name}_b" for name in METRICS)
    columns = ", ".join(f"a.{name}" for name in CELL)
    same = " and ".join(f"a.{name} is not distinct from b.{name}" for name in CELL)
    try:
        found = connection.sql(PAIRS.format(columns=columns, metrics=metrics, same=same))
    except duckdb.Error as error:
        raise PairedError(
            f"{a.address} and {b.address} are not of this version: {str(error).splitlines()[0]}"
        ) from error
    rows = [dict(zip(found.columns, values, strict=True)) for values in found.fetchall()]
    if not rows:
        raise PairedError(f"{a.address} and {b.address} share no flight: fly the same rows and cells")
    if any(row["seed_a"] != row["seed_b"] for row in rows):
        raise PairedError(f"{a.address} and {b.address} flew other seeds: give both plans one seed")
    cells: dict[Cell, list[dict[str, Any]]] = {}
    for row in rows:
        cells.setdefault(tuple(row[name] for name in CELL), []).append(row)
    for cell, some in cells.items():
        if len({row["trial"] for row in some}) < len(some):
            raise PairedError(f"{_name(cell)} was flown twice in one of the two: which flights are pairs is not known")
    made = [_compared(_name(cell), some) for cell, some in cells.items()]
    if len(made) > 1:
        made.append(_compared("all", rows))
    for side in ("a", "b"):
        flown = connection.sql(f"select {', '.join(CELL)} from {side} group by all order by row, min(cell)").fetchall()
        alone = [_name(cell) for cell in flown if cell not in cells]
        made += [Compared(name=name, rates=[], medians=[], only=side.upper()) for name in alone]
    return made


def _name(cell: Cell) -> str:
    """For people: without what is as usual."""
    of = dict(zip(CELL, cell, strict=True))
    parts = [
        *(of["row"], of["task"], f"{of['speed_mps']:g} m/s over {of['length_m']:g} m"),
        f"{of['spacing_m']:g} m" if of["world"] == "forest" else of["world"],
        "" if of["course"] == "goal" else of["course"],
        "" if of["evader"] == "planned" else of["evader"],
        f"wind {of['wind_mps']:g} m/s" if of["wind_mps"] else "",
        f"{of['moving']} moving" if of["moving"] else "",
        of["pilot"],
    ]
    return ", ".join(part for part in parts if part)


def _compared(name: str, rows: list[dict[str, Any]]) -> Compared:
    rates: list[RateDifference] = []
    for rate, what in RATES.items():
        pairs = [(row[f"{rate}_a"], row[f"{rate}_b"]) for row in rows]
        only_a, only_b, both = (pairs.count(pair) for pair in ((True, False), (False, True), (True, True)))
        rates.append(RateDifference(what=what, flights=len(pairs), only_a=only_a, only_b=only_b, both=both))
    medians = [
        median_difference(what, [(row[f"{of}_a"], row[f"{of}_b"]) for row in rows]) for of, what in METRICS.items()
    ]
    return Compared(name=name, rates=rates, medians=[median for median in medians if median])


def median_difference(what: str, pairs: list[tuple[float | None, float | None]]) -> MedianDifference | None:
    """Of what both of a pair have; `None` of too few."""
    differences = sorted(b - a for a, b in pairs if a is not None and b is not None)
    count = len(differences)
    # The least place such that the median lies outside with 2.5 % to each side, at most.
    place = int(stats.binom.ppf((1 - LEVEL) / 2, count, 0.5)) if count else 0
    if not place:
        return None  # of five flights or fewer, not even the least and the greatest hold it so surely
    low, high = differences[place - 1], differences[count - place]
    middle = (differences[(count - 1) // 2] + differences[count // 2]) / 2
    greater, less = sum(d > 0 for d in differences), sum(d < 0 for d in differences)
    return MedianDifference(what=what, flights=count, greater=greater, less=less, median=middle, interval=(low, high))


def words(a: str, b: str, made: list[Compared]) -> str:
    """For people: what B does more or less than A."""
    lines = [f"A: {a}", f"B: {b}", "The same flights in both, by seed; 95 % intervals; p of each line by itself."]
    for cell in made:
        lines.append(f"\n{cell.name}")
        if cell.only:
            lines.append(f"  left out: only {cell.only} flew it")
        for rate in cell.rates:
            low, high = rate.interval
            lines.append(
                f"  {rate.what}: B {100 * rate.difference:+.2f} % ({100 * low:+.2f} to {100 * high:+.2f}), in "
                f"{rate.flights} flights only A {rate.only_a}, only B {rate.only_b}; {_p(rate.p)} (McNemar, exact)"
            )
        for median in cell.medians:
            low, high = median.interval
            lines.append(
                f"  {median.what}: B {median.median:+.3g} in the median ({low:+.3g} to {high:+.3g}), greater in "
                f"{median.greater}, less in {median.less} of {median.flights}; {_p(median.p)} (sign test, exact)"
            )
    return "\n".join(lines)


def facts(made: list[Compared]) -> list[dict[str, Any]]:
    """For programs."""
    return [
        {
            "cell": cell.name,
            "only": cell.only,
            "rates": [
                {**asdict(rate), "difference": rate.difference, "interval": rate.interval, "p": rate.p}
                for rate in cell.rates
            ],
            "medians": [{**asdict(median), "p": median.p} for median in cell.medians],
        }
        for cell in made
    ]


def _p(p: float) -> str:
    return "p < 0.0001" if p < 1e-4 else f"p {p:.4f}"
