"""The total loss of a batch (eq. total_cost). Shape letters: B batch, C channels, N anchors."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from goshawk_train.assign import Assignment, assign
from goshawk_train.config import Config
from goshawk_train.costs import CostModel, CostTerms, boundary_vectors
from goshawk_train.data import Batch
from goshawk_train.decode import Decoded, Decoder


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """A batch's loss and what it was made of."""

    loss: Tensor
    terms: CostTerms
    label_BN: Tensor
    decoded: Decoded
    assignment: Assignment
    parts: dict[str, Tensor]
    """Means for the log."""


class LossModel:
    """Decoding, costs and label assignment put together."""

    def __init__(self, config: Config, costs: CostModel) -> None:
        self.config, self.costs = config, costs
        self.decoder = Decoder(config)

    def __call__(self, prediction_BCRC: Tensor, batch: Batch) -> Outcome:
        """The loss of raw predictions, float32."""
        config, weights = self.config, self.config.costs
        decoded = self.decoder(prediction_BCRC)
        groups = assign(batch.target_net_B3, batch.visible_B, config)
        tracking = config.task == "track"
        positive = groups.positive_BN if tracking else torch.ones_like(groups.positive_BN)
        goal_weight = torch.where(positive, weights.tracking, weights.guidance) * batch.has_goal_B[:, None]
        situation = dataclasses.replace(batch.situation, goal_weight_BN=goal_weight)
        d = boundary_vectors(
            batch.velocity_net_B3, batch.acceleration_net_B3, decoded.end_cam_BN33, batch.world_from_net_B33
        )
        terms = self.costs(d, situation)
        label = terms.label_BN(with_goal=not tracking).detach().clamp_max(weights.cost_label_max)
        cost_loss = F.smooth_l1_loss(decoded.cost_BN, label, reduction="none")
        trajectory = terms.trajectory_BN()
        share = torch.where(positive, 1.0, weights.lambda_other)
        each = share * (trajectory + weights.cost_loss * cost_loss)
        parts = {
            "trajectory": _mean(trajectory, positive),
            "cost_error": cost_loss.mean(),
            **{f.name[:-3]: _mean(getattr(terms, f.name), positive) for f in dataclasses.fields(terms)[:7]},
        }
        if decoded.objectness_logit_BN is not None and decoded.target_cam_BN3 is not None:
            truth = positive.to(each.dtype)
            objectness = F.binary_cross_entropy_with_logits(decoded.objectness_logit_BN, truth, reduction="none")
            object_share = truth + weights.lambda_negative * groups.negative_BN
            target = F.smooth_l1_loss(
                decoded.target_cam_BN3, batch.target_net_B3[:, None].expand_as(decoded.target_cam_BN3), reduction="none"
            ).sum(-1)
            each = each + weights.objectness_loss * object_share * objectness + weights.target_loss * truth * target
            parts["objectness"] = (object_share * objectness).sum(-1).mean()
            parts["target"] = _mean(target, positive)
        loss = each.sum(-1).mean()
        return Outcome(
            loss=loss, terms=terms, label_BN=label, decoded=decoded, assignment=groups, parts={"loss": loss, **parts}
        )


def _mean(value: Tensor, mask: Tensor) -> Tensor:
    """Mean over the masked anchors; 0 without any."""
    return (value * mask).sum() / mask.sum().clamp_min(1)
