"""What a training begins with instead of random weights: another run's, or those of a policy as it flies.

Export folds every batch norm into the convolution before it, so a policy's file has none. Here each gets the statistics
of images and the scale and shift that undo them: the network says the same, and trains as one that never was folded.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import onnx
import torch
from google.protobuf.message import DecodeError
from torch import Tensor, nn

from goshawk_train.config import STATE_SIZES, Config
from goshawk_train.model.card import CONTRACT_KEY
from goshawk_train.model.checkpoint import CheckpointError, load
from goshawk_train.model.network import Policy

NORM_OF = {"0": "1", "conv1": "bn1", "conv2": "bn2"}
"""The batch norm's name by that of the convolution before it, within their block."""


@dataclass(frozen=True, kw_only=True)
class Beginning:
    """Weights, and where they come from."""

    weights: dict[str, Tensor]
    """By their names in `Policy`."""
    origin: str
    """For the model card: samples and data."""
    state_sizes: dict[str, int]
    """What its state input holds, in order."""
    folded: bool = False
    """Whether the batch norms do nothing and want `normalise`."""

    def head_for(self, config: Config) -> Tensor:
        """The weights of the head's first layer, for another state: those of its inputs go by their names. Inputs that
        it did not have get none, and those that it alone has are left out."""
        whole, own = self.weights["head1.weight"], self.state_sizes
        sizes = [whole.shape[1] - sum(own.values()), *own.values()]
        image, *parts = cast("tuple[Tensor, ...]", whole.split(sizes, dim=1))
        known = dict(zip(own, parts, strict=True))
        new = [known.get(name, whole.new_zeros(len(whole), size, 1, 1)) for name, size in config.state_sizes.items()]
        return torch.cat([image, *new], dim=1)


def of_run(path: Path) -> Beginning:
    """The averaged weights of a run's checkpoint; raises `CheckpointError`."""
    saved = load(path)
    samples = saved.step * saved.config.training.batch
    weights = {**saved.network, **saved.ema}
    origin = f"{samples} samples of {saved.data}"
    return Beginning(weights=weights, origin=origin, state_sizes=saved.config.state_sizes)


def of_policy(path: Path) -> Beginning:
    """The weights of a file that `export` made; raises `CheckpointError`."""
    try:
        model = onnx.load(str(path))
        contract = json.loads({entry.key: entry.value for entry in model.metadata_props}[CONTRACT_KEY])
        training = contract["training"]
        origin = f"{training['samples']} samples of {training['data']}"
        state_sizes = {name: STATE_SIZES[name] for name in contract["state"]}
    except OSError as error:
        raise CheckpointError(f"{path}: {error.strerror}") from error
    except (DecodeError, KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"{path} is no policy that `goshawk train export` wrote") from error
    values = {
        entry.name: torch.tensor(np.array(onnx.numpy_helper.to_array(entry))) for entry in model.graph.initializer
    }
    for node in model.graph.node:  # weights that are kept in half precision
        if node.op_type == "Cast" and node.input[0] in values:
            values[node.output[0]] = values[node.input[0]].float()
    names: dict[str, str] = {}
    for node in model.graph.node:  # and in 8 bits
        if node.op_type == "DequantizeLinear" and node.input[0] in values:
            whole, scale, zero = (values[name].float() for name in node.input)
            of_row = (-1, *(1,) * (whole.dim() - 1))
            values[node.output[0]] = (whole - zero.reshape(of_row)) * scale.reshape(of_row)
            names[node.output[0]] = node.input[0].removesuffix("_quantized")
    weights: dict[str, Tensor] = {}
    for node in model.graph.node:
        if node.op_type != "Conv":
            continue
        name = names.get(node.input[1], node.input[1]).removesuffix(".weight")
        bias = values[node.input[2]]
        weights[f"{name}.weight"] = values[node.input[1]]
        block, _, last = name.rpartition(".")
        if last not in NORM_OF:  # the head's, which have a bias of their own
            weights[f"{name}.bias"] = bias
            continue
        norm = nn.BatchNorm2d(len(bias))
        unit = {"weight": torch.full_like(bias, (1 + norm.eps) ** 0.5), "bias": bias}
        weights |= {f"{block}.{NORM_OF[last]}.{key}": value for key, value in {**norm.state_dict(), **unit}.items()}
    return Beginning(weights=weights, origin=origin, state_sizes=state_sizes, folded=True)


def normalise(network: Policy, rgbd_B4HW: Tensor) -> None:
    """Give every batch norm the statistics of these images, and change its scale and shift so that the network says
    what it said."""
    norms = [module for module in network.modules() if isinstance(module, nn.BatchNorm2d)]
    seen: dict[nn.Module, tuple[Tensor, Tensor]] = {}

    def look(module: nn.Module, inputs: tuple[Tensor]) -> None:
        variance, mean = torch.var_mean(inputs[0], dim=(0, 2, 3), correction=0)
        seen[module] = (mean, variance)

    hooks = [norm.register_forward_pre_hook(look) for norm in norms]
    network.eval()
    with torch.no_grad():
        network.features(rgbd_B4HW)
        for norm, hook in zip(norms, hooks, strict=True):
            hook.remove()
            mean, variance = seen[norm]
            assert norm.running_mean is not None and norm.running_var is not None
            scale = norm.weight / (norm.running_var + norm.eps).sqrt()
            norm.bias.add_((mean - norm.running_mean) * scale)
            norm.weight.copy_(scale * (variance + norm.eps).sqrt())
            norm.running_mean.copy_(mean)
            norm.running_var.copy_(variance)
