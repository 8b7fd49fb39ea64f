"""Plots keep a sliding window in constant memory."""

from __future__ import annotations

import numpy as np
from goshawk_dashboards.instruments.history import History


def test_memory_is_constant_however_long_it_runs() -> None:
    history = History(columns=3, capacity=100)
    before = history.nbytes
    for k in range(10_000):
        history.add(k * 0.05, np.array([k, 2.0 * k, -k]))
    assert len(history) == 100
    assert history.nbytes == before


def test_the_window_holds_the_newest_rows_in_order() -> None:
    history = History(columns=1, capacity=100)
    for k in range(257):
        history.add(k * 0.1, np.array([float(k)]))
    ago, rows = history.window(5.0)
    np.testing.assert_allclose(rows[:, 0], np.arange(206, 257))
    np.testing.assert_allclose(ago, (np.arange(206, 257) - 256) * 0.1, atol=1e-9)


def test_a_partly_filled_history_shows_what_it_has() -> None:
    history = History(columns=1, capacity=100)
    assert len(history.window(5.0)[0]) == 0
    for k in range(3):
        history.add(float(k), np.array([float(k)]))
    ago, rows = history.window(10.0)
    np.testing.assert_allclose(ago, [-2.0, -1.0, 0.0])
    np.testing.assert_allclose(rows[:, 0], [0.0, 1.0, 2.0])


def test_a_restarted_vehicle_starts_a_new_window() -> None:
    history = History(columns=1, capacity=100)
    for k in range(150):
        history.add(1000.0 + k, np.array([1.0]))
    history.add(2.0, np.array([5.0]))
    history.add(3.0, np.array([6.0]))
    _, rows = history.window(1e9)
    np.testing.assert_allclose(rows[:, 0], [5.0, 6.0])


def test_a_row_of_earlier_stands_in_its_place_and_none_stands_twice() -> None:
    history = History(columns=1, capacity=4)
    for k in (0.0, 1.0, 10.0, 11.0, 12.0):
        history.add(k, np.array([k]))
    history.fill(11.01, np.array([99.0]))
    history.fill(5.0, np.array([5.0]))
    ago, rows = history.window(60.0)
    assert rows[:, 0].tolist() == [5.0, 10.0, 11.0, 12.0]
    assert ago.tolist() == [-7.0, -2.0, -1.0, 0.0]
    history.add(13.0, np.array([13.0]))
    assert history.window(60.0)[1][:, 0].tolist() == [10.0, 11.0, 12.0, 13.0]
