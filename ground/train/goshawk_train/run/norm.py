"""Batch norms whose statistics are of the images of all processes: torch's own that do so need a GPU.

Shape letters: B images, C channels, H, W.
"""

from __future__ import annotations

from typing import Any, Self

import torch
import torch.distributed as dist
from torch import Tensor, nn


class _Total(torch.autograd.Function):
    """The sum over all processes. The loss is the sum of their losses, so its gradient is a sum as well."""

    @staticmethod
    def forward(ctx: Any, value: Tensor) -> Tensor:
        """The sum of all processes' values."""
        total = value.clone()
        dist.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        """The sum of all processes' gradients."""
        total = gradients[0].clone()
        dist.all_reduce(total)
        return total


class JointBatchNorm(nn.BatchNorm2d):
    """`BatchNorm2d` over all processes, which may have unequal numbers of images."""

    @classmethod
    def of(cls, norm: nn.BatchNorm2d) -> Self:
        """The same norm, joint."""
        joint = cls(norm.num_features, eps=norm.eps, momentum=norm.momentum)
        joint.load_state_dict(norm.state_dict())
        return joint

    def forward(self, input: Tensor) -> Tensor:
        """[B, C, H, W] to the same."""
        if not self.training:
            return super().forward(input)
        assert self.running_mean is not None and self.running_var is not None and self.num_batches_tracked is not None
        assert self.momentum is not None
        # Moments in double precision: the variance is a small difference of large numbers.
        own, dtype = input.to(self.weight.dtype), self.weight.dtype
        variance, mean = (each.double() for each in torch.var_mean(own, dim=(0, 2, 3), correction=0))
        count = variance.new_tensor([own.numel() // self.num_features])
        moments: Tensor = _Total.apply(torch.cat([count * mean, count * (variance + mean**2), count]))
        count = moments[-1].detach()
        mean, square = (moments[:-1] / count).chunk(2)
        variance = square - mean**2
        with torch.no_grad():
            self.num_batches_tracked += 1
            self.running_mean.lerp_(mean.to(dtype), self.momentum)
            self.running_var.lerp_((variance * count / (count - 1)).to(dtype), self.momentum)
        scale = self.weight * (variance + self.eps).rsqrt().to(dtype)
        shift = self.bias - mean.to(dtype) * scale
        return (own * scale[:, None, None] + shift[:, None, None]).to(input.dtype)
