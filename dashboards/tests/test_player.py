"""The review's player: time passes as told, and jumps where it is told."""

from __future__ import annotations

import numpy as np
import pytest
from goshawk_dashboards.review.player import SCRUB_HOLD_S, Player

STOPS_S = np.array([0.0, 1.0, 1.033, 2.0])


def test_time_passes_only_while_it_plays_and_at_the_speed_chosen() -> None:
    player = Player(10.0)
    player.advance(1.0)
    assert player.time_s == 0.0
    player.toggle()
    player.set_speed(0.1)
    player.advance(1.0)
    assert player.time_s == pytest.approx(0.1)
    player.set_speed(10.0)
    player.advance(0.5)
    assert player.time_s == pytest.approx(5.1)
    player.toggle()
    player.advance(1.0)
    assert player.time_s == pytest.approx(5.1)


def test_it_stops_at_the_end_and_plays_again_from_the_start() -> None:
    player = Player(2.0)
    player.toggle()
    player.advance(5.0)
    assert (player.time_s, player.playing) == (2.0, False)
    player.toggle()
    assert (player.time_s, player.playing) == (0.0, True)


def test_a_seek_stays_within_the_recording() -> None:
    player = Player(2.0)
    player.seek(7.0)
    assert player.time_s == 2.0
    player.seek(-1.0)
    assert player.time_s == 0.0
    assert player.moved.is_set()


def test_an_axis_may_begin_before_second_0() -> None:
    player = Player(2.0, begin_s=-3.0)
    assert player.time_s == 0.0
    player.seek(-7.0)
    assert player.time_s == -3.0
    player.seek(2.0)
    player.toggle()
    assert (player.time_s, player.playing) == (-3.0, True)


def test_playing_waits_for_the_hand_on_the_timeline() -> None:
    player = Player(10.0)
    player.toggle()
    player.scrub(4.0)
    player.advance(SCRUB_HOLD_S)
    assert player.time_s == 4.0
    player.advance(0.5)
    assert player.time_s == pytest.approx(4.5)


def test_steps_visit_every_stop_in_both_directions_and_pause() -> None:
    player = Player(2.0)
    player.toggle()
    seen = []
    for _ in range(5):
        player.step(STOPS_S, 1)
        seen.append(player.time_s)
    assert seen == [1.0, 1.033, 2.0, 2.0, 2.0]
    assert not player.playing
    for _ in range(5):
        player.step(STOPS_S, -1)
        seen.append(player.time_s)
    assert seen[5:] == [1.033, 1.0, 0.0, 0.0, 0.0]


def test_a_step_from_between_two_stops_goes_to_the_neighbours() -> None:
    player = Player(2.0)
    player.seek(1.5)
    player.step(STOPS_S, -1)
    assert player.time_s == 1.033
    player.seek(1.5)
    player.step(STOPS_S, 1)
    assert player.time_s == 2.0


def test_rounding_by_the_slider_does_not_repeat_a_frame() -> None:
    player = Player(2.0)
    player.seek(1.0333)
    player.step(np.array([1.0, 1.0333, 1.0667]), 1)
    assert player.time_s == 1.0667
