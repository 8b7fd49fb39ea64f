"""What one training step sees: images, states, targets, and where its samples are in their scenes' maps.

Shape letters: I images, B samples (each image with the same number of states), H, W, 3 an FLU or ENU vector, S state.
The "net" frame is the camera frame, or its mirror image left to right for mirrored samples.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True, kw_only=True)
class Situation:
    """Where the samples of a batch are, and what they should do."""

    pos_world_B3: Tensor
    scene_B: Tensor
    aim_rel_B3: Tensor
    """Where the trajectory should end, relative to the camera's position, world axes, m."""
    agility_B: Tensor
    """Share of a_max that the vehicle can give, above 0, at most 1."""

    def to(self, device: torch.device) -> Situation:
        """The same situations on another device."""
        return Situation(**{name: value.to(device) for name, value in vars(self).items()})


@dataclass(frozen=True, kw_only=True)
class Batch:
    """What one training step sees; the states of an image stand in a row."""

    rgbd_I4HW: Tensor
    state_BS: Tensor
    velocity_net_B3: Tensor
    acceleration_net_B3: Tensor
    world_from_net_B33: Tensor
    """Improper for mirrored samples."""
    target_net_B3: Tensor
    visible_B: Tensor
    """Share of the target that is seen; NaN where that is unknown."""
    situation: Situation

    def to(self, device: torch.device) -> Batch:
        """The same batch on another device."""
        tensors = {name: value.to(device) for name, value in vars(self).items() if isinstance(value, Tensor)}
        return dataclasses.replace(self, **tensors, situation=self.situation.to(device))
