"""Network output to end states and detections (eq. 4-9), differentiable; camera frame, SI, alpha = 1.

Shape letters: B batch, C channels, N anchors (row-major), 3 an FLU vector.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import torch
import torch.nn.functional as F
from torch import Tensor

from goshawk_train.config import Config
from goshawk_train.model import geometry


@dataclass(frozen=True, kw_only=True)
class Decoded:
    """What the policy says, per anchor. The last two are None in navigation."""

    end_cam_BN33: Tensor
    """Rows f(T), f'(T), f''(T); m, m/s, m/s^2."""
    cost_BN: Tensor
    objectness_logit_BN: Tensor | None
    target_cam_BN3: Tensor | None
    """Position of the target's centre, m."""


class Decoder:
    """The constants of decoding, built once from a configuration."""

    def __init__(self, config: Config, *, dtype: torch.dtype = torch.float32) -> None:
        elevation, azimuth = geometry.anchor_angles(config.camera, config.lattice)
        self.elevation_N = torch.tensor(elevation, dtype=dtype)
        self.azimuth_N = torch.tensor(azimuth, dtype=dtype)
        self.cam_from_cell_N33 = torch.tensor(geometry.cam_from_cell(config.camera, config.lattice), dtype=dtype)
        anchor = torch.arange(config.lattice.anchors)
        self.row_N = (anchor // config.lattice.columns).to(dtype)
        self.column_N = (anchor % config.lattice.columns).to(dtype)
        self.config = config

    def __call__(self, prediction_BCRC: Tensor) -> Decoded:
        """Decode raw network output [B, C, rows, columns]."""
        lattice, motion, camera = self.config.lattice, self.config.motion, self.config.camera
        y = prediction_BCRC.flatten(2).transpose(1, 2)
        bound = torch.tanh(y[..., :9])
        elevation = self.elevation_N + bound[..., 0] * lattice.elevation_offset_rad
        azimuth = self.azimuth_N + bound[..., 1] * lattice.azimuth_offset_rad
        radius = lattice.radius_m * (1 + bound[..., 2])
        flat = radius * torch.cos(elevation)
        pos = torch.stack([flat * torch.cos(azimuth), flat * torch.sin(azimuth), radius * torch.sin(elevation)], -1)
        scale = bound.new_tensor([[motion.v_max_mps], [motion.a_max_mps2]])
        derivatives_cell = cast("Tensor", bound[..., 3:9].unflatten(-1, (2, 3))) * scale
        derivatives = torch.einsum("nij,bndj->bndi", self.cam_from_cell_N33, derivatives_cell)
        end = torch.cat([pos.unsqueeze(2), derivatives], dim=2)
        cost = F.softplus(y[..., 9])
        if self.config.task == "navigate":
            return Decoded(end_cam_BN33=end, cost_BN=cost, objectness_logit_BN=None, target_cam_BN3=None)
        cell_px = camera.width / lattice.columns
        u = (2 * torch.sigmoid(y[..., 11]) - 0.5 + self.column_N) * cell_px
        v = (2 * torch.sigmoid(y[..., 12]) - 0.5 + self.row_N) * cell_px
        depth = self.config.network.target_depth_scale_m * F.softplus(y[..., 13])
        left = (camera.width / 2 - u) / camera.focal_px * depth
        up = (camera.height / 2 - v) / camera.focal_px * depth
        target = torch.stack([depth, left, up], dim=-1)
        return Decoded(end_cam_BN33=end, cost_BN=cost, objectness_logit_BN=y[..., 10], target_cam_BN3=target)
