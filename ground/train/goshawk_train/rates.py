"""How often something happened in some flights, and how much less often in the same ones flown otherwise."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any

import scipy.stats

stats: Any = scipy.stats  # comes without types
LEVEL = 0.95
"""Of all intervals."""


@dataclass(frozen=True, kw_only=True)
class Rate:
    """How often something happened in some flights."""

    count: int
    flights: int

    @property
    def interval(self) -> tuple[float, float]:
        """The exact one (Clopper and Pearson's)."""
        return interval(self.count, self.flights, "exact")

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.count / self.flights:.2%} ({low:.2%} to {high:.2%})"


def interval(count: int, flights: int, method: str) -> tuple[float, float]:
    """Of a rate, at `LEVEL`; the method is "exact" or "wilson"."""
    low, high = stats.binomtest(count, flights).proportion_ci(LEVEL, method=method)
    return float(low), float(high)


@dataclass(frozen=True, kw_only=True)
class RateDifference:
    """How often something happens in B less than in A, in the same flights."""

    what: str
    flights: int
    only_a: int
    only_b: int
    both: int

    @property
    def difference(self) -> float:
        """B's rate less A's."""
        return (self.only_b - self.only_a) / self.flights

    @property
    def p(self) -> float:
        """McNemar's exact test, two-sided: of the flights that differ, either is as likely."""
        differ = self.only_a + self.only_b
        return float(stats.binomtest(self.only_b, differ).pvalue) if differ else 1.0

    @property
    def interval(self) -> tuple[float, float]:
        """Of the difference: Newcombe's for paired rates (1998, method 10), of Wilson's of each."""
        n, a, b = self.flights, self.only_a + self.both, self.only_b + self.both
        neither = n - self.both - self.only_a - self.only_b
        (low_a, high_a), (low_b, high_b) = interval(a, n, "wilson"), interval(b, n, "wilson")
        together = self.both * neither - self.only_a * self.only_b
        spread = a * (n - a) * b * (n - b)
        correlation = 0.0 if not spread else (max(together - n / 2, 0) if together > 0 else together) / sqrt(spread)

        def reach(down: float, up: float) -> float:
            return sqrt(max(0.0, down**2 - 2 * correlation * down * up + up**2))

        low = self.difference - reach(b / n - low_b, high_a - a / n)
        return low, self.difference + reach(high_b - b / n, a / n - low_a)
