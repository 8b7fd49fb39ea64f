"""Which anchors hold the target (section III-E, target detection). Shape letters: B batch, N anchors, 3 FLU."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from goshawk_train.config import Config


@dataclass(frozen=True, kw_only=True)
class Assignment:
    """Masks [B, N]; every anchor is exactly one of the three."""

    positive_BN: Tensor
    ignored_BN: Tensor
    negative_BN: Tensor


def assign(target_cam_B3: Tensor, visible_B: Tensor, config: Config) -> Assignment:
    """Sort the anchors by the distance from their cell to the target's projected centre, at the target's depth.

    `target_cam_B3` m, anything where `visible_B` (the unoccluded fraction, 0..1) is 0. The cell that holds the
    projection is positive. Nothing is positive of a target seen less than `visible_min`: what would be is ignored.
    All is ignored where `visible_B` is NaN: nobody knows whether there is a target.
    """
    camera, lattice, rule = config.camera, config.lattice, config.assign
    anchor = torch.arange(lattice.anchors, device=target_cam_B3.device)
    cell_px = camera.width / lattice.columns
    left_px = (anchor % lattice.columns) * cell_px
    top_px = torch.div(anchor, lattice.columns, rounding_mode="floor") * cell_px
    depth = target_cam_B3[:, 0].clamp_min(1e-3)
    u = (camera.width / 2 - camera.focal_px * target_cam_B3[:, 1] / depth)[:, None]
    v = (camera.height / 2 - camera.focal_px * target_cam_B3[:, 2] / depth)[:, None]
    outside_u = torch.maximum(left_px - u, u - (left_px + cell_px)).clamp_min(0)
    outside_v = torch.maximum(top_px - v, v - (top_px + cell_px)).clamp_min(0)
    distance_m = torch.hypot(outside_u, outside_v) * depth[:, None] / camera.focal_px
    exists = ((visible_B > 0) & (target_cam_B3[:, 0] > 0))[:, None]
    near = exists & (distance_m <= rule.positive_m) & (torch.maximum(outside_u, outside_v) <= rule.reach_px)
    positive = near & (visible_B >= rule.visible_min)[:, None]
    ignored = (exists & (distance_m <= rule.ignored_m) & ~positive) | visible_B.isnan()[:, None]
    return Assignment(positive_BN=positive, ignored_BN=ignored, negative_BN=~(positive | ignored))
