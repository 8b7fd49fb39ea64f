"""The policy network (section III-B): a ResNet-18 of any width in each stage, 32x down to the lattice, and a 1x1 head.

Inputs in the camera frame; the state's rotation into each cell's frame is a constant matrix inside.
"""

from __future__ import annotations

from typing import cast

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor, nn

from goshawk_train.config import TASK_STATES, Config
from goshawk_train.model import geometry

TRAJECTORY_CHANNELS = 10
"""Of the outputs, the first: end state and cost. The rest is detection."""


def _conv(inputs: int, outputs: int, size: int, stride: int) -> nn.Conv2d:
    conv = nn.Conv2d(inputs, outputs, size, stride=stride, padding=size // 2, bias=False)
    nn.init.kaiming_normal_(conv.weight, mode="fan_out", nonlinearity="relu")
    return conv


class Block(nn.Module):
    """ResNet's basic block."""

    def __init__(self, inputs: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = _conv(inputs, outputs, 3, stride)
        self.bn1 = nn.BatchNorm2d(outputs)
        self.conv2 = _conv(outputs, outputs, 3, 1)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.skip: nn.Module = nn.Identity()
        if stride != 1 or inputs != outputs:
            self.skip = nn.Sequential(_conv(inputs, outputs, 1, stride), nn.BatchNorm2d(outputs))

    def forward(self, x: Tensor) -> Tensor:
        """[B, inputs, H, W] to [B, outputs, H / stride, W / stride]."""
        y = F.relu(self.bn1(self.conv1(x)), inplace=True)
        return F.relu(self.bn2(self.conv2(y)) + self.skip(x), inplace=True)


def cell_state_matrix(config: Config) -> np.ndarray:
    """[S * N, S]: the state's vectors, each rotated into every cell's frame, and its numbers as they are, laid out
    [S, N] row-major."""
    cell_from_cam = np.swapaxes(geometry.cam_from_cell(config.camera, config.lattice), 1, 2)
    total, anchors = sum(config.state_sizes.values()), config.lattice.anchors
    matrix = np.zeros((total, anchors, total))
    at = 0
    for size in config.state_sizes.values():
        here = slice(at, at + size)
        matrix[here, :, here] = np.swapaxes(cell_from_cam, 0, 1) if size == 3 else 1
        at += size
    return matrix.reshape(total * anchors, total)


class Policy(nn.Module):
    """rgbd [B, 4, H, W] in 0..1 and state [B, S] to raw predictions [B, C, rows, columns]."""

    cell_state: Tensor

    def __init__(self, config: Config) -> None:
        super().__init__()
        channels = config.network.channels
        self.stem = nn.Sequential(
            _conv(4, channels[0], 7, 2), nn.BatchNorm2d(channels[0]), nn.ReLU(inplace=True), nn.MaxPool2d(3, 2, 1)
        )
        inputs = channels[0]
        blocks: list[nn.Module] = []
        for stage, outputs in enumerate(channels):
            blocks += [Block(inputs, outputs, 1 if stage == 0 else 2), Block(outputs, outputs, 1)]
            inputs = outputs
        self.blocks = nn.Sequential(*blocks)
        state = sum(config.state_sizes.values())
        self.motion_states = sum(size for name, size in config.state_sizes.items() if name not in TASK_STATES)
        """Of the state, the first: how the camera moves and hangs. The rest is the task."""
        hidden = config.network.head_channels
        self.head1 = nn.Conv2d(inputs + state, hidden, 1)
        self.head2 = nn.Conv2d(hidden, hidden, 1)
        self.out = nn.Conv2d(hidden, len(config.channel_names), 1)
        nn.init.normal_(self.out.weight, std=0.01)
        bias = torch.zeros(len(config.channel_names))
        if config.task == "track":
            bias[config.channel_names.index("objectness")] = -2.5  # about one cell of fifteen holds the target
        self.out.bias = nn.Parameter(bias)
        self.lattice = (config.lattice.rows, config.lattice.columns)
        matrix = torch.tensor(cell_state_matrix(config), dtype=torch.float32)
        self.register_buffer("cell_state", matrix, persistent=False)

    def features(self, rgbd_B4HW: Tensor) -> Tensor:
        """The backbone alone: [B, channels, rows, columns]."""
        return self.blocks(self.stem(rgbd_B4HW))

    def head(self, features: Tensor, state_BS: Tensor) -> Tensor:
        """The 1x1 head; weights are shared by all cells. What detects the target does not get the task: the aim and the
        agility, with which the state ends."""
        trajectories = self._head(features, state_BS)
        if trajectories.shape[1] == TRAJECTORY_CHANNELS or state_BS.shape[1] == self.motion_states:
            return trajectories
        # Where the target is said to be must not tell where it is seen.
        motion, task = state_BS.tensor_split([self.motion_states], dim=1)
        unaimed = torch.cat([motion, torch.zeros_like(task)], dim=1)
        detections = self._head(features, unaimed)
        return torch.cat([trajectories[:, :TRAJECTORY_CHANNELS], detections[:, TRAJECTORY_CHANNELS:]], dim=1)

    def _head(self, features: Tensor, state_BS: Tensor) -> Tensor:
        rotated = cast("Tensor", F.linear(state_BS, self.cell_state).unflatten(1, (-1, *self.lattice)))
        x = torch.cat([features, rotated], dim=1)
        x = F.relu(self.head1(x))
        return self.out(F.relu(self.head2(x)))

    def forward(self, rgbd: Tensor, state: Tensor) -> Tensor:
        """The whole network, float32."""
        return self.head(self.features(rgbd), state)


def parameter_count(module: nn.Module) -> int:
    """Number of trained values."""
    return sum(p.numel() for p in module.parameters())
