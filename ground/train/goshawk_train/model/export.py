"""A checkpoint to the ONNX file that flies: contract in the metadata, checked against ONNX Runtime."""

from __future__ import annotations

import dataclasses
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any, cast

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray

from goshawk_train.config import Config
from goshawk_train.errors import TrainerError
from goshawk_train.model.card import CONTRACT_KEY
from goshawk_train.model.checkpoint import Checkpoint, load_weights
from goshawk_train.model.network import TRAJECTORY_CHANNELS, Policy

OPSET = 18
AGREEMENT = 1e-4
"""Largest difference allowed between PyTorch and ONNX Runtime, relative where values exceed 1."""
AGREEMENT_HALF = 1e-2
"""The same with weights that are kept in half precision."""
HALVED_FROM = 1024
"""Numbers of a weight that is worth halving."""


class ExportError(TrainerError):
    """The exported file is not what was trained; the message says what differs."""


def contract(saved: Checkpoint, *, commit: str, cost_scale: float) -> dict[str, Any]:
    """What the onboard side must honour; everything but `training` is checked there field by field."""
    config = saved.config
    camera, lattice = config.camera, config.lattice
    return {
        "version": 2,
        "task": config.task,
        "image": {
            "width": camera.width,
            "height": camera.height,
            "hfov_rad": camera.hfov_rad,
            "vfov_rad": camera.vfov_rad,
        },
        "depth": {
            "min_m": config.depth.min_m,
            "max_m": config.depth.max_m,
            "fill_passes": config.depth.fill_passes,
        },
        "lattice": {
            "rows": lattice.rows,
            "columns": lattice.columns,
            "radius_m": lattice.radius_m,
            "elevation_offset_rad": lattice.elevation_offset_rad,
            "azimuth_offset_rad": lattice.azimuth_offset_rad,
        },
        "v_max_mps": config.motion.v_max_mps,
        "a_max_mps2": config.motion.a_max_mps2,
        "duration_rule": "2r/(alpha*v_max)",
        "target_depth_scale_m": config.network.target_depth_scale_m,
        "cost_scale": cost_scale,
        "state": list(config.network.state),
        "channels": config.channel_names,
        "camera_tilt_rad": camera.tilt_rad,
        "training": {
            "data": saved.data,
            "commit": commit,
            "seed": config.seed,
            "samples": saved.step * config.training.batch,
            "hours": round(saved.seconds / 3600, 3),
            "hardware": saved.hardware,
        },
    }


def current_commit() -> str:
    """The repository's revision, "unknown" outside of one."""
    try:
        command = ["git", "-C", str(Path(__file__).parent), "rev-parse", "--short=12", "HEAD"]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def example_inputs(config: Config, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Random inputs of the exported shapes."""
    generator = torch.Generator().manual_seed(seed)
    rgbd = torch.rand(1, 4, config.camera.height, config.camera.width, generator=generator)
    return rgbd, torch.randn(1, sum(config.state_sizes.values()), generator=generator)


def halve(model: onnx.ModelProto) -> None:
    """Keep the large weights in half precision; ONNX Runtime makes them float32 once, as it loads the file."""
    graph = model.graph
    for weight in list(graph.initializer):
        values = onnx.numpy_helper.to_array(weight)
        if values.dtype != np.float32 or values.size < HALVED_FROM:
            continue
        name = f"{weight.name}.half"
        graph.initializer.remove(weight)
        graph.initializer.append(onnx.numpy_helper.from_array(values.astype(np.float16), name))
        graph.node.insert(0, onnx.helper.make_node("Cast", [name], [weight.name], to=onnx.TensorProto.FLOAT))


def export(saved: Checkpoint, path: Path, *, commit: str, cost_scale: float, half: bool = False) -> dict[str, Any]:
    """Write the averaged weights as ONNX (batch 1, float32) and return the contract; raises `ExportError`.

    `cost_scale` is what `Validator.cost_scale` measured of the same weights: the planner weighs what it adds by it.
    `half` keeps the large weights in half precision: half the file.
    """
    if not cost_scale > 0:
        raise ExportError(f"the costs of all candidates are the same (spread {cost_scale}); train for longer")
    network = Policy(saved.config)
    load_weights(network, saved)
    network.eval()
    inputs = example_inputs(saved.config, 0)
    with tempfile.TemporaryDirectory() as folder:
        raw = Path(folder) / "policy.onnx"
        torch.onnx.export(
            network,
            inputs,
            str(raw),
            input_names=["rgbd", "state"],
            output_names=["prediction"],
            opset_version=OPSET,
            dynamo=True,
            external_data=False,
            verbose=False,
        )
        model = onnx.load(str(raw))
    if half:
        halve(model)
    agreed = contract(saved, commit=commit, cost_scale=cost_scale)
    del model.metadata_props[:]
    model.metadata_props.add(key=CONTRACT_KEY, value=json.dumps(agreed))
    for node in model.graph.node:  # the exporter notes source paths and stack traces there
        node.ClearField("doc_string")
        del node.metadata_props[:]
    for value in [*model.graph.value_info, *model.graph.input, *model.graph.output]:
        del value.metadata_props[:]
    onnx.checker.check_model(model, full_check=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial")
    partial.write_bytes(model.SerializeToString())
    verify(network, partial, saved.config, agreement=AGREEMENT_HALF if half else AGREEMENT)
    partial.replace(path)
    return agreed


def verify(network: Policy, path: Path, config: Config, *, trials: int = 4, agreement: float = AGREEMENT) -> float:
    """Largest difference between the network and the file in ONNX Runtime; raises `ExportError` above `agreement`."""
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    inputs = cast("list[Any]", session.get_inputs())
    shapes = {i.name: tuple(i.shape) for i in inputs}
    worst = 0.0
    for trial in range(trials):
        rgbd, state = example_inputs(config, 1 + trial)
        if shapes != {"rgbd": tuple(rgbd.shape), "state": tuple(state.shape)}:
            raise ExportError(f"{path} has inputs {shapes}")
        with torch.no_grad():
            want = network(rgbd, state).numpy()
        outputs = cast("Any", session).run(["prediction"], {"rgbd": rgbd.numpy(), "state": state.numpy()})
        got = cast("NDArray[np.float32]", outputs[0])
        if got.shape != want.shape:
            raise ExportError(f"{path} gives shape {got.shape}, the network {want.shape}")
        worst = max(worst, float(np.max(np.abs(got - want) / np.maximum(1, np.abs(want)))))
    if not worst <= agreement:
        raise ExportError(f"{path} differs from the network by {worst:.2e}, more than {agreement:.0e}")
    return worst


def for_navigation(saved: Checkpoint) -> Checkpoint:
    """The trajectories of a tracking run as a navigation policy: the same network without its detection channels.

    Raises `ExportError` if the run's state does not tell where to fly.
    """
    if saved.config.task == "navigate":
        return saved
    if not saved.config.has_goal:
        state = ", ".join(saved.config.network.state)
        raise ExportError(f"a state of {state} has no aim and no direction, so it cannot navigate; train one that has")

    def cut(state: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        return {k: v[:TRAJECTORY_CHANNELS] if k.startswith("out.") else v for k, v in state.items()}

    config = dataclasses.replace(saved.config, task="navigate")
    return dataclasses.replace(saved, config=config, network=cut(saved.network), ema=cut(saved.ema))
