"""How far the target's estimate was from the truth, where a simulator logged it. Shape suffix: M instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.state.views import Array


@dataclass(frozen=True, kw_only=True, eq=False)
class TargetErrors:
    """Estimate less truth in the plane, along and across the line of sight, as in the paper."""

    times_s_M: Array
    lateral_m_M: Array
    """To the left."""
    longitudinal_m_M: Array
    """Beyond."""


def target_errors(flight: Flight) -> TargetErrors | None:
    """For each confirmed estimate with truth around it; None if there is none."""
    truth = flight.columns("sim_truth", ["pos_world", "target_pos_world"])
    estimate = flight.columns("target", ["stamp_ns", "pos_world", "confirmed"])
    known = np.isfinite(np.hstack([truth["target_pos_world"], truth["pos_world"]])).all(axis=1)
    if np.count_nonzero(known) < 2 or len(estimate) == 0:
        return None
    known_s = truth.times_s[known]
    stamps_s = (estimate["stamp_ns"] - flight.start_ns) * 1e-9
    use = estimate["confirmed"].astype(bool) & np.isfinite(estimate["pos_world"]).all(axis=1)
    use &= (stamps_s >= known_s[0]) & (stamps_s <= known_s[-1])
    if not use.any():
        return None
    times_s_M = stamps_s[use]
    target_M3 = _at(times_s_M, known_s, truth["target_pos_world"][known])
    sight_M2 = (target_M3 - _at(times_s_M, known_s, truth["pos_world"][known]))[:, :2]
    along_M2 = sight_M2 / np.maximum(np.linalg.norm(sight_M2, axis=1, keepdims=True), 1e-6)
    error_M2 = (estimate["pos_world"][use] - target_M3)[:, :2]
    return TargetErrors(
        times_s_M=times_s_M,
        lateral_m_M=along_M2[:, 0] * error_M2[:, 1] - along_M2[:, 1] * error_M2[:, 0],
        longitudinal_m_M=(along_M2 * error_M2).sum(axis=1),
    )


def _at(times_s_M: Array, known_s: Array, values_3: Array) -> Array:
    """Values between the known ones, linearly."""
    return np.stack([np.interp(times_s_M, known_s, values_3[:, k]) for k in range(3)], axis=1)
