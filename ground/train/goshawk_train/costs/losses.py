"""The total loss of a batch (eq. total_cost). Shape letters: B batch, C channels, N anchors."""

from __future__ import annotations

from dataclasses import dataclass

import torch.nn.functional as F
from torch import Tensor

from goshawk_train.config import Config
from goshawk_train.costs.assign import Assignment, assign
from goshawk_train.costs.batch import Batch
from goshawk_train.costs.trajectory import CostModel, CostTerms, boundary_vectors
from goshawk_train.model.decode import Decoded, Decoder


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
        d = boundary_vectors(
            batch.velocity_net_B3, batch.acceleration_net_B3, decoded.end_cam_BN33, batch.world_from_net_B33
        )
        terms = self.costs(d, batch.situation)
        trajectory = terms.trajectory_BN()
        positive = groups.positive_BN.to(trajectory.dtype)
        share: Tensor | float = 1.0
        label = trajectory
        if config.task == "track":
            share = positive + weights.lambda_other * (1 - positive)
            if weights.goal_rule == "paper":
                label = trajectory - terms.goal_BN
                trajectory = label + positive * terms.goal_BN
        label = label.detach().clamp_max(weights.cost_label_max)
        cost_loss = F.smooth_l1_loss(decoded.cost_BN, label, reduction="none")
        each = weights.trajectory_loss * share * (trajectory + weights.cost_loss * cost_loss)
        parts = {
            "trajectory": trajectory.mean(),
            "cost_error": cost_loss.mean(),
            **{name: part_BN.mean() for name, part_BN in terms.parts_BN().items()},
        }
        if decoded.objectness_logit_BN is not None and decoded.target_cam_BN3 is not None:
            objectness = F.binary_cross_entropy_with_logits(decoded.objectness_logit_BN, positive, reduction="none")
            object_share = positive + weights.lambda_negative * groups.negative_BN
            target = F.smooth_l1_loss(
                decoded.target_cam_BN3, batch.target_net_B3[:, None].expand_as(decoded.target_cam_BN3), reduction="none"
            ).sum(-1)
            each = each + weights.objectness_loss * object_share * objectness + weights.target_loss * positive * target
            parts["objectness"] = (object_share * objectness).sum(-1).mean()
            parts["target"] = (target * positive).sum() / positive.sum().clamp_min(1)
        loss = each.sum(-1).mean()
        return Outcome(
            loss=loss, terms=terms, label_BN=label, decoded=decoded, assignment=groups, parts={"loss": loss, **parts}
        )
