"""Makes the tiny ONNX files beside it, which `tests/policy.rs` loads: `python air/policy/tests/models/make_models.py`.

The good ones compute mean(rgbd) over the image, joined with the state, times WEIGHTS plus a bias, so that a test can
work out every output by hand. Each bad one has one thing wrong.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

MODELS_DIR = Path(__file__).resolve().parent
TRACK_CHANNELS = ["theta", "phi", "r", "vx", "vy", "vz", "ax", "ay", "az", "cost", "objectness", "du", "dv", "distance"]
STATE = ["velocity", "acceleration", "up", "aim", "agility"]
STATE_NUMBERS = 13


def contract(task: str) -> dict[str, Any]:
    """A version 2 contract as the training side writes it."""
    navigate = task == "navigate"
    return {
        "version": 2,
        "task": task,
        "image": {"width": 160, "height": 96, "hfov_rad": math.pi / 2, "vfov_rad": 2 * math.atan(48 / 80)},
        "depth": {"min_m": 0.2, "max_m": 20.0, "fill_passes": 2},
        "lattice": {
            "rows": 3,
            "columns": 5,
            "radius_m": 5.0,
            "elevation_offset_rad": math.radians(15),
            "azimuth_offset_rad": math.radians(15),
        },
        "v_max_mps": 6.0,
        "a_max_mps2": 6.0,
        "duration_rule": "2r/(alpha*v_max)",
        "target_depth_scale_m": 5.0,
        "cost_scale": 6.0,
        "state": STATE,
        "channels": TRACK_CHANNELS[:10] if navigate else TRACK_CHANNELS,
        "camera_tilt_rad": 0.0,
        "training": {"data": "none", "commit": "none", "seed": 0, "samples": 0, "hours": 0.0},
    }


def weights(inputs: int, outputs: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """[inputs, outputs]: ((7 i + 3 j) mod 11 - 5) / 10."""
    i, j = np.arange(inputs)[:, None], np.arange(outputs)[None, :]
    return (((7 * i + 3 * j) % 11 - 5) / 10).astype(np.float32)


def good(task: str, *, swapped: bool = False) -> onnx.ModelProto:
    """A model that does what `contract(task)` says."""
    agreed = contract(task)
    channels, numbers = len(agreed["channels"]), STATE_NUMBERS
    outputs = channels * 15
    bias = (np.arange(outputs) / 100).astype(np.float32)
    nodes = [
        helper.make_node("ReduceMean", ["rgbd", "axes"], ["means"], keepdims=0),
        helper.make_node("Concat", ["means", "state"], ["joined"], axis=1),
        helper.make_node("Gemm", ["joined", "weights", "bias"], ["flat"]),
        helper.make_node("Reshape", ["flat", "shape"], ["prediction"]),
    ]
    constants = [
        numpy_helper.from_array(np.array([2, 3], np.int64), "axes"),
        numpy_helper.from_array(weights(4 + numbers, outputs), "weights"),
        numpy_helper.from_array(bias, "bias"),
        numpy_helper.from_array(np.array([1, channels, 3, 5], np.int64), "shape"),
    ]
    inputs = [("rgbd", [1, 4, 96, 160]), ("state", [1, numbers])]
    return model(nodes, constants, inputs[::-1] if swapped else inputs, [1, channels, 3, 5], agreed)


def constant(
    agreed: dict[str, Any] | None,
    *,
    state: tuple[str, int] = ("state", STATE_NUMBERS),
    output: tuple[int, ...] = (1, 14, 3, 5),
    dtype: int = TensorProto.FLOAT,
) -> onnx.ModelProto:
    """A model that ignores its inputs and gives zeros: small, for whatever is refused before it runs."""
    shape = numpy_helper.from_array(np.array(output, np.int64), "shape")
    zero = helper.make_tensor("zero", dtype, [1], [0])
    nodes = [helper.make_node("ConstantOfShape", ["shape"], ["prediction"], value=zero)]
    return model(nodes, [shape], [("rgbd", [1, 4, 96, 160]), (state[0], [1, state[1]])], list(output), agreed, dtype)


def model(
    nodes: list[onnx.NodeProto],
    constants: list[onnx.TensorProto],
    inputs: list[tuple[str, list[int]]],
    output: list[int],
    agreed: dict[str, Any] | None,
    dtype: int = TensorProto.FLOAT,
) -> onnx.ModelProto:
    """Wraps a graph with the contract in its metadata."""
    graph = helper.make_graph(
        nodes,
        "test",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in inputs],
        [helper.make_tensor_value_info("prediction", dtype, output)],
        constants,
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    if agreed is not None:
        made.metadata_props.add(key="goshawk_contract", value=json.dumps(agreed))
    onnx.checker.check_model(made, full_check=True)
    return made


def main() -> None:
    """Writes every file."""
    track = contract("track")
    models = {
        "track": good("track"),
        "track_swapped_inputs": good("track", swapped=True),
        "navigate": good("navigate"),
        "no_contract": constant(None),
        "wrong_version": constant({**track, "version": 1}),
        "unknown_field": constant({**track, "novelty": 1}),
        "other_image": constant({**track, "image": {**track["image"], "width": 320}}),
        "wrong_output_shape": constant(track, output=(1, 10, 3, 5)),
        "wrong_output_type": constant(track, dtype=TensorProto.DOUBLE),
        "wrong_state_length": constant(track, state=("state", 6)),
        "wrong_input_name": constant(track, state=("motion", STATE_NUMBERS)),
    }
    for name, made in models.items():
        (MODELS_DIR / f"{name}.onnx").write_bytes(made.SerializeToString(deterministic=True))


if __name__ == "__main__":
    main()
