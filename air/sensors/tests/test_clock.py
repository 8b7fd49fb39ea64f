"""From what a camera tells of its time to the middle of the exposure on CLOCK_MONOTONIC."""

from __future__ import annotations

from itertools import pairwise

import pytest
from goshawk_sensors.cameras.clock import LONGEST_NS, Moment, Replayed, Told, stamp

ARRIVAL = Moment(wall_ns=1_800_000_000_000_000_000, monotonic_ns=5_000_000_000)
MS = 1_000_000
READ_OUT_MS = ARRIVAL.wall_ns / MS - 10.0
"""By the wall clock: the read-out began 10 ms before the arrival."""


@pytest.mark.parametrize(
    ("told", "age_ms"),
    [
        (Told(wall_ms=READ_OUT_MS, frame_us=70_000, sensor_us=64_000, exposure_us=4000), 16.0),
        (Told(wall_ms=READ_OUT_MS, exposure_us=8000), 14.0),
        (Told(wall_ms=READ_OUT_MS), 30.0),
        (Told(wall_ms=None, frame_us=70_000, sensor_us=64_000), 30.0),
    ],
    ids=["sensor timestamp", "half the exposure", "nothing of the exposure", "no wall clock"],
)
def test_the_best_that_the_camera_tells_is_used(told: Told, age_ms: float) -> None:
    found = stamp(told, ARRIVAL, latency_ms=30.0)
    assert (ARRIVAL.monotonic_ns - found.monotonic_ns) / MS == pytest.approx(age_ms, abs=0.001)


@pytest.mark.parametrize("off_ms", [-3_600_000.0, -300.0, 100.0, 3_600_000.0])
def test_a_wall_clock_that_was_set_gives_no_stamp(off_ms: float) -> None:
    found = stamp(Told(wall_ms=READ_OUT_MS + off_ms, exposure_us=8000), ARRIVAL, latency_ms=30.0)
    assert found.source == "its arrival less 30 ms"
    assert ARRIVAL.monotonic_ns - found.monotonic_ns == 30 * MS


def test_a_replayed_image_is_never_of_the_future_and_as_far_from_the_one_before_as_it_was_taken() -> None:
    replayed = Replayed()
    late_ms = [9, 4, 0, 2, 8, 1]
    stamps: list[int] = []
    for k, late in enumerate(late_ms):
        arrival_ns = 10_000 * MS + (33 * k + late) * MS
        stamps.append(replayed.stamp(777.0 + 33.0 * k, arrival_ns).monotonic_ns)
        assert stamps[-1] <= arrival_ns
    assert [after - before for before, after in pairwise(stamps[2:])] == [33 * MS] * 3


def test_after_a_pause_a_replayed_image_is_new_again() -> None:
    replayed = Replayed()
    replayed.stamp(0.0, 0)
    arrival_ns = 2 * LONGEST_NS
    assert replayed.stamp(33.0, arrival_ns).monotonic_ns == arrival_ns
