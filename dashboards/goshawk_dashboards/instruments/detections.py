"""What one plan saw of the target, judged on the ground as the vehicle's filter judges it (eq. 10).

The wire carries detections and estimates, and not the filter's judgement. So the estimate before is predicted to the
image's stamp, and the gate is worked out anew with the vehicle's own tuning. An estimate from the link may be some
images old, which widens the gate a little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from goshawk_dashboards.instruments.tuning import GateTuning
from goshawk_dashboards.state.views import Array, PlanView, TargetView

PREDICTED_S = 0.5
"""An estimate older than this predicts no detection."""
LIKELY = 0.5
"""The objectness of a detection where the tuning is not known: likelier a target than none."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """The detections of one plan."""

    count: int
    """Sure enough to be looked at."""
    passed: int | None
    """Of these, consistent with the estimate; None: the gate is not known."""
    objectness: float | None = None
    """Of the one that the filter takes, the surest that passes; None: there is none."""
    innovation_world_3: Array | None = None
    """It, minus where the estimate before expected it, m."""
    sigmas: float | None = None
    """That in standard deviations, to be compared with the gate; None: the gate is not known."""
    rival_objectness: float | None = None
    """Of the surest one that does not pass."""
    rival_m: float | None = None
    """How far that is from the expected target."""


def seen(before: TargetView, plan: PlanView, tuning: GateTuning | None) -> Seen | None:
    """None: the estimate before is not one of a little earlier, or the plan is of a navigation."""
    after_s = (plan.frame_ns - before.stamp_ns) * 1e-9
    if plan.target_pos_world_N3 is None or before.covariance_66 is None or not 0.0 < after_s < PREDICTED_S:
        return None
    looked = [int(k) for k in np.argsort(-plan.objectness_N) if plan.objectness_N[k] >= _least(plan, tuning)]
    innovation_N3 = plan.target_pos_world_N3 - before.pos_world_3 - before.vel_world_3 * after_s
    if tuning is None:
        fit, unfit, sigmas_N = looked, list[int](), None
    else:
        sigmas_N = _sigmas_N(before, before.covariance_66, plan, innovation_N3, after_s, tuning)
        fit = [k for k in looked if sigmas_N[k] <= tuning.gate_sigmas]
        unfit = [k for k in looked if sigmas_N[k] > tuning.gate_sigmas]
    return Seen(
        count=len(looked),
        passed=None if tuning is None else len(fit),
        objectness=float(plan.objectness_N[fit[0]]) if fit else None,
        innovation_world_3=innovation_N3[fit[0]] if fit else None,
        sigmas=float(sigmas_N[fit[0]]) if fit and sigmas_N is not None else None,
        rival_objectness=float(plan.objectness_N[unfit[0]]) if unfit else None,
        rival_m=float(np.linalg.norm(innovation_N3[unfit[0]])) if unfit else None,
    )


def _least(plan: PlanView, tuning: GateTuning | None) -> float:
    """A weak detection counts where there is no strong one."""
    if tuning is None:
        return LIKELY
    strong = bool((plan.objectness_N >= tuning.min_objectness).any())
    return tuning.min_objectness if strong else tuning.keep_objectness


def _sigmas_N(
    before: TargetView, cov_66: Array, plan: PlanView, innovation_N3: Array, after_s: float, tuning: GateTuning
) -> Array:
    """Each innovation in its own covariance: the estimate's, predicted, and the detection's along its line of sight."""
    cross_33 = cov_66[:3, 3:]
    predicted_33 = cov_66[:3, :3] + (cross_33 + cross_33.T) * after_s + cov_66[3:, 3:] * after_s**2
    assert plan.target_pos_world_N3 is not None
    sight_N3 = plan.target_pos_world_N3 - plan.start_pos_world_3
    far_N = np.linalg.norm(sight_N3, axis=1)
    line_N3 = sight_N3 / np.maximum(far_N, 1e-9)[:, None]
    larger_N = (1.0 + (far_N / tuning.variance_distance_m) ** 2)[:, None, None]
    across, along = tuning.lateral_variance_m2, tuning.range_variance_m2
    detection_N33 = larger_N * (across * np.eye(3) + (along - across) * line_N3[:, :, None] * line_N3[:, None, :])
    total_N33: Array = predicted_33 + detection_N33
    precision_N33 = np.linalg.inv(total_N33)
    return np.sqrt(np.einsum("ni,nij,nj->n", innovation_N3, precision_N33, innovation_N3))
