"""A checkpoint to the ONNX file that flies: contract in the metadata, checked against ONNX Runtime, model card."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import torch

from goshawk_train.checkpoint import Checkpoint, load_weights
from goshawk_train.config import STATE_SIZES, Config
from goshawk_train.flights import MARKS
from goshawk_train.network import TRAJECTORY_CHANNELS, Policy, parameter_count

CONTRACT_KEY = "goshawk_contract"
OPSET = 18
AGREEMENT = 1e-4
"""Largest difference allowed between PyTorch and ONNX Runtime, relative where values exceed 1."""


FILE_MARKS = ("<!-- file: begin -->", "<!-- file: end -->")
"""What `goshawk-sim golden` writes in the card stands between these."""


class ExportError(RuntimeError):
    """The exported file is not what was trained; the message says what differs."""


def contract(saved: Checkpoint, *, commit: str) -> dict[str, Any]:
    """What the onboard side must honour; everything but `training` is checked there field by field."""
    config = saved.config
    camera, lattice = config.camera, config.lattice
    return {
        "version": 1,
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
        "state": config.state_names,
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
    return rgbd, torch.randn(1, sum(STATE_SIZES.values()), generator=generator)


def export(saved: Checkpoint, path: Path, *, commit: str) -> dict[str, Any]:
    """Write the averaged weights as ONNX (batch 1, float32) and return the contract; raises `ExportError`."""
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
    agreed = contract(saved, commit=commit)
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
    verify(network, partial, saved.config)
    partial.replace(path)
    return agreed


def verify(network: Policy, path: Path, config: Config, *, trials: int = 4) -> float:
    """Largest difference between the network and the file in ONNX Runtime; raises `ExportError` above 1e-4."""
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    shapes = {i.name: tuple(i.shape) for i in session.get_inputs()}
    worst = 0.0
    for trial in range(trials):
        rgbd, state = example_inputs(config, 1 + trial)
        if shapes != {"rgbd": tuple(rgbd.shape), "state": tuple(state.shape)}:
            raise ExportError(f"{path} has inputs {shapes}")
        with torch.no_grad():
            want = network(rgbd, state).numpy()
        got: Any = session.run(["prediction"], {"rgbd": rgbd.numpy(), "state": state.numpy()})[0]
        if got.shape != want.shape:
            raise ExportError(f"{path} gives shape {got.shape}, the network {want.shape}")
        worst = max(worst, float(np.max(np.abs(got - want) / np.maximum(1, np.abs(want)))))
    if not worst <= AGREEMENT:
        raise ExportError(f"{path} differs from the network by {worst:.2e}, more than {AGREEMENT:.0e}")
    return worst


def for_navigation(saved: Checkpoint) -> Checkpoint:
    """The trajectories of a tracking run as a navigation policy: the same network without its detection channels."""
    if saved.config.task == "navigate":
        return saved

    def cut(state: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        return {k: v[:TRAJECTORY_CHANNELS] if k.startswith("out.") else v for k, v in state.items()}

    config = dataclasses.replace(saved.config, task="navigate")
    return dataclasses.replace(saved, config=config, network=cut(saved.network), ema=cut(saved.ema))


def model_card(
    saved: Checkpoint, agreed: dict[str, Any], metrics: dict[str, float], *, trained_as: str, frames: int, file: Path
) -> str:
    """The Markdown that lies beside a shipped policy; `trained_as` is the task of the run."""
    config, training = saved.config, agreed["training"]
    network = Policy(config)
    figures = "\n".join(f"| {name} | {value:.4g} |" for name, value in metrics.items())
    return f"""# Policy `{file.name}`

Task: {config.task}. ResNet-18 with stages of {", ".join(map(str, config.network.channels))} channels,
{parameter_count(network):,} parameters, float32, {file.stat().st_size / 1e6:.1f} MB. Input: RGB-D of
{config.camera.width} x {config.camera.height} and {sum(STATE_SIZES.values())} state values
({", ".join(config.state_names)}; camera frame). Output: {config.lattice.anchors} anchors of
{len(config.channel_names)} channels. The contract is in the file's metadata, key `{CONTRACT_KEY}`.

## Training
{training["samples"]:,} samples in {training["hours"]:.2f} h on {training["hardware"]}; weight average
{config.training.ema:g}, seed {training["seed"]}, commit `{training["commit"]}`, configuration
`ground/train/configs/{trained_as}.toml`. Data set: {training["data"]}.

## Held-out scenes
{min(config.training.validate_frames, frames)} frames of scenes never trained on, states drawn like the training's.
Distances in m. `collide_*`: share of trajectories that come nearer than 0.16 m to an obstacle within T, many of them
from states that no trajectory could save (drawn at random: full speed, half a metre before a trunk).

| metric | value |
|---|---|
{figures}

## Flights
`python -m goshawk_train flights` writes here what the policy flew, worst cells included.

{MARKS[0]}
Not flown yet.
{MARKS[1]}

## Limits
Trained on synthetic forests with a synthetic person only, at alpha = 1; flight scales by alpha. It sees one frame:
what is hidden behind a trunk is unknown to it. Targets were 1.2 to 18 m away.

## File
`goshawk-sim golden --policy {file.name}` adds the golden images, without which no vehicle is ready.

{FILE_MARKS[0]}
| file | SHA-256 |
|---|---|
| model | `{hashlib.sha256(file.read_bytes()).hexdigest()}` |
{FILE_MARKS[1]}
"""
