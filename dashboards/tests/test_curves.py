"""The rebuilt trajectories are the quintics that the vehicle flies."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from goshawk_dashboards.scene.curves import coefficients_N63, evaluate_NS3
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

VECTORS = Path(__file__).resolve().parents[2] / "tests/vectors/quintic.json"
STATES_9 = hnp.arrays(np.float64, (9,), elements=st.floats(-50, 50))


@given(STATES_9, hnp.arrays(np.float64, (4, 9), elements=st.floats(-50, 50)), st.floats(0.1, 10.0))
def test_a_quintic_meets_both_boundary_states(start_9: np.ndarray, end_N9: np.ndarray, duration_s: float) -> None:
    start, end = np.split(start_9, 3), np.split(end_N9, 3, axis=1)
    coef = coefficients_N63((start[0], start[1], start[2]), (end[0], end[1], end[2]), duration_s)
    for k in range(3):
        at_NS3 = evaluate_NS3(coef, np.array([0.0, duration_s]), derivative=k)
        np.testing.assert_allclose(at_NS3[:, 0], np.tile(start[k], (4, 1)), atol=1e-9)
        np.testing.assert_allclose(at_NS3[:, 1], end[k], atol=1e-6 * max(1.0, duration_s**-2))


def test_derivatives_are_slopes() -> None:
    rng = np.random.default_rng(3)
    coef = rng.normal(size=(3, 6, 3))
    times, step = np.linspace(0.1, 2.0, 7), 1e-5
    for k in range(3):
        slope = (evaluate_NS3(coef, times + step, k) - evaluate_NS3(coef, times - step, k)) / (2 * step)
        np.testing.assert_allclose(evaluate_NS3(coef, times, k + 1), slope, rtol=1e-6, atol=1e-6)


def test_curves_agree_with_the_golden_vectors() -> None:
    cases = json.loads(VECTORS.read_text())["cases_B"]
    assert cases
    for case in cases:
        start, end = np.array(case["start_33"]), np.array(case["end_33"])[:, None]
        coef = coefficients_N63((start[0], start[1], start[2]), (end[0], end[1], end[2]), case["duration"])
        for sample in case["samples_K"]:
            for k, name in enumerate(("pos", "vel", "acc", "jerk")):
                got = evaluate_NS3(coef, np.array([sample["t"]]), k)[0, 0]
                np.testing.assert_allclose(got, sample[name], rtol=1e-9, atol=1e-7)


@pytest.mark.parametrize("duration_s", [0.0, -1.0, float("nan"), float("inf")])
def test_a_duration_that_is_not_positive_and_finite_is_refused(duration_s: float) -> None:
    zero_3, zero_13 = np.zeros(3), np.zeros((1, 3))
    with pytest.raises(ValueError, match="duration"):
        coefficients_N63((zero_3, zero_3, zero_3), (zero_13, zero_13, zero_13), duration_s)
