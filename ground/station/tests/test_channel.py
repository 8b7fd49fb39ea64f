"""Rates, ages and losses of one channel, from times and sequence numbers alone."""

from __future__ import annotations

import pytest
from goshawk_ground.link.channel import CAPACITY, ChannelStats
from hypothesis import given
from hypothesis import strategies as st


def fed(seqs: list[int | None], period_s: float = 0.02, size: int = 100) -> tuple[ChannelStats, float]:
    """A channel whose samples came evenly, and the time of the last."""
    stats = ChannelStats("x")
    for k, seq in enumerate(seqs):
        stats.arrived(10.0 + k * period_s, size, seq)
    return stats, 10.0 + (len(seqs) - 1) * period_s


def test_nothing_lost_is_no_loss() -> None:
    stats, now_s = fed(list(range(1, 101)))
    view = stats.view(now_s)
    assert view.loss_fraction == 0.0
    assert view.count == 100
    assert view.rate_hz == pytest.approx(50.0, rel=0.01)
    assert view.bytes_per_s == pytest.approx(5000.0, rel=0.01)


@given(st.sets(st.integers(2, 99), max_size=90))
def test_loss_is_the_share_of_missing_numbers(lost: set[int]) -> None:
    stats, now_s = fed([s for s in range(1, 101) if s not in lost])
    assert stats.view(now_s).loss_fraction == pytest.approx(len(lost) / 100)


def test_a_restarted_sender_is_not_a_loss() -> None:
    stats, now_s = fed([5000, 5001, 5002, 1, 2, 3])
    assert stats.view(now_s).loss_fraction == 0.0


def test_a_channel_without_numbers_has_no_loss_figure() -> None:
    stats, now_s = fed([None] * 10)
    assert stats.view(now_s).loss_fraction is None


def test_a_silent_channel_ages_and_its_rate_falls_to_nothing() -> None:
    stats, now_s = fed(list(range(1, 101)))
    later = stats.view(now_s + 3.0)
    assert later.age_s == pytest.approx(3.0)
    assert later.rate_hz < 30.0
    silent = stats.view(now_s + 60.0)
    assert silent.rate_hz == 0.0
    assert silent.bytes_per_s == 0.0
    assert silent.age_s == pytest.approx(60.0)


def test_an_unheard_channel_has_no_age() -> None:
    view = ChannelStats("x").view(5.0)
    assert view.age_s is None
    assert view.rate_hz == 0.0


def test_memory_is_bounded_at_any_rate() -> None:
    stats = ChannelStats("x")
    for k in range(10 * CAPACITY):
        stats.arrived(k * 1e-5, 10, k)
    assert len(stats._arrivals) <= CAPACITY  # pyright: ignore[reportPrivateUsage] - it is what must be bounded
    assert stats.view(10 * CAPACITY * 1e-5).count == 10 * CAPACITY


def test_malformed_payloads_are_counted_and_are_not_samples() -> None:
    stats = ChannelStats("x")
    stats.malformed()
    stats.malformed()
    view = stats.view(1.0)
    assert (view.malformed, view.count, view.age_s) == (2, 0, None)
