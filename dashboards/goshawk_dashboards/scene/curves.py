"""Rebuilds trajectories from their end states: the closed-form quintic of the paper's eq. 1-2, vectorised.

Shape suffixes: N trajectories, S samples, 3 axes; coefficients are ascending powers, 6 of them.
"""

from __future__ import annotations

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from numpy.typing import NDArray

from goshawk_dashboards.page import theme
from goshawk_dashboards.state.views import Array, PlanView


def coefficients_N63(
    start_3: tuple[Array, Array, Array], end_N3: tuple[Array, Array, Array], duration_s: float
) -> Array:
    """The quintics from one (position, velocity, acceleration) to N others in ``duration_s`` > 0.

    Raises ValueError if the duration is not positive and finite.
    """
    if not (np.isfinite(duration_s) and duration_s > 0.0):
        raise ValueError(f"duration must be positive and finite, not {duration_s} s")
    pos, vel, acc = start_3
    end_pos, end_vel, end_acc = end_N3
    t = duration_s
    # What is left of each derivative at T after the start state has run on alone.
    gap_pos = end_pos - (pos + vel * t + 0.5 * acc * t**2)
    gap_vel = (end_vel - (vel + acc * t)) * t
    gap_acc = (end_acc - acc) * t**2
    out = np.empty((len(end_pos), 6, 3))
    out[:, 0], out[:, 1], out[:, 2] = pos, vel, 0.5 * acc
    out[:, 3] = (10.0 * gap_pos - 4.0 * gap_vel + 0.5 * gap_acc) / t**3
    out[:, 4] = (-15.0 * gap_pos + 7.0 * gap_vel - gap_acc) / t**4
    out[:, 5] = (6.0 * gap_pos - 3.0 * gap_vel + 0.5 * gap_acc) / t**5
    return out


def evaluate_NS3(coef_N63: Array, times_S: Array, derivative: int = 0) -> Array:
    """The trajectories, or their ``derivative``-th derivative, at each time."""
    powers = np.arange(6)
    factor_6 = np.ones(6)
    for k in range(derivative):
        factor_6 *= np.maximum(powers - k, 0)
    exponent_6 = np.maximum(powers - derivative, 0)
    basis_S6 = factor_6 * np.asarray(times_S)[:, None] ** exponent_6
    return np.einsum("sk,nka->nsa", basis_S6, coef_N63)


def plan_curves_NS3(plan: PlanView, samples: int = 24) -> Array:
    """Positions along every candidate of a plan, evenly spaced in time from 0 to its duration, world frame."""
    coef_N63 = coefficients_N63(
        (plan.start_pos_world_3, plan.start_vel_world_3, plan.start_acc_world_3),
        (plan.end_pos_world_N3, plan.end_vel_world_N3, plan.end_acc_world_N3),
        plan.duration_s,
    )
    return evaluate_NS3(coef_N63, np.linspace(0.0, plan.duration_s, samples))


def choices_N(plan: PlanView) -> NDArray[np.bool_]:
    """Which candidates were real choices: the one flown, and those that were merely dearer."""
    choice = (pb.REJECTION_NONE, pb.REJECTION_COST)
    return np.array([r in choice or k == plan.chosen for k, r in enumerate(plan.rejections)], dtype=bool)


def colors_N3(plan: PlanView) -> NDArray[np.uint8]:
    """Of each candidate: by cost if it was a real choice, grey if it was rejected for another reason."""
    real_N = choices_N(plan)
    out_N3 = np.tile(np.array(theme.REJECTED, dtype=np.uint8), (len(real_N), 1))
    out_N3[real_N] = theme.cost_colors_N3(plan.cost_N[real_N])
    return out_N3
