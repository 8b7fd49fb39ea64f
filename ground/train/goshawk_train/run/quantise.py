"""A policy whose backbone calculates in 8 bits: on a processor with instructions for it nearly twice as fast."""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import onnx
import onnxruntime
from google.protobuf.message import DecodeError
from numpy.typing import NDArray
from onnxruntime import quantization
from onnxruntime.quantization import CalibrationDataReader, QuantType

from goshawk_train.config import STATE_SIZES, DepthConfig
from goshawk_train.data.layout import read_images, read_labels, read_view, scene_folders
from goshawk_train.data.preprocess import rgbd_tensor
from goshawk_train.errors import TrainerError
from goshawk_train.model.card import CONTRACT_KEY

F32 = NDArray[np.float32]

HEAD = ("head1.weight", "head2.weight", "out.weight")
"""What sees the state, in 15 cells: it takes hardly any time, and its answers are lengths and costs."""
QUANTISED = ["Conv", "Relu", "Add", "MaxPool"]
"""What calculates in 8 bits, before the head."""
MOST = 0.1
"""An answer may differ so much, as a share of its channel's standard deviation (root mean square)."""


class QuantiseError(TrainerError):
    """The policy cannot be quantised, or is another one then; the message says why."""


@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How near the answers are to those of the policy before, on images that nothing was calibrated with."""

    calibrated: int
    """Images that showed the ranges."""
    images: int
    """Others."""
    differences: dict[str, float]
    """By channel: root mean square, as a share of the channel's standard deviation."""
    same_choice: float
    """Share of images whose cheapest candidate is the same."""


class _Images(CalibrationDataReader):
    def __init__(self, images: list[F32], states: list[F32]) -> None:
        self.left = zip(images, states, strict=True)

    def get_next(self) -> dict[str, F32] | None:  # type: ignore[override]  # the library's own hint is of bytes
        image, state = next(self.left, (None, None))
        return None if image is None or state is None else {"rgbd": image, "state": state}


def quantise(policy: Path, data: Path, out: Path, *, frames: int) -> Agreement:
    """Writes `policy` with a backbone in 8 bits, whose ranges are those that `frames` images of `data` show; raises
    `QuantiseError` or `DataError`.

    Weights have 7 bits and activations 8: older processors add two products in 16 bits, and more would overflow there.
    """
    model, contract = _policy(policy)
    images = list(_images(data, contract, frames=2 * frames))
    rng = np.random.default_rng(0)  # the backbone does not see the state; to compare answers any will do
    size = sum(STATE_SIZES[name] for name in contract["state"])
    states = [np.clip(rng.standard_normal((1, size)), -2, 2).astype(np.float32) for _ in images]
    head = [node.name for node in model.graph.node if node.op_type == "Conv" and node.input[1] in HEAD]
    with tempfile.TemporaryDirectory() as folder:
        plain, small = Path(folder) / "plain.onnx", Path(folder) / "small.onnx"
        onnx.save(model, str(plain))
        logging.getLogger().disabled = True  # the library advises a preparation that changes nothing here
        try:
            cast("Any", quantization).quantize_static(
                str(plain),
                str(small),
                _Images(images[::2], states[::2]),
                op_types_to_quantize=QUANTISED,
                nodes_to_exclude=head,
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                per_channel=True,
                reduce_range=True,
                extra_options={"WeightSymmetric": True},
            )
        finally:
            logging.getLogger().disabled = False
        made = onnx.load(str(small))
        del made.metadata_props[:]
        made.metadata_props.extend(model.metadata_props)
        onnx.checker.check_model(made, full_check=True)
        onnx.save(made, str(small))
        agreement = _agreement(plain, small, images, states, contract["channels"])
        worst = max(agreement.differences, key=lambda name: agreement.differences[name])
        if not agreement.differences[worst] <= MOST:
            raise QuantiseError(
                f"in 8 bits {policy} answers otherwise: {worst} by {agreement.differences[worst]:.2f} of its standard "
                f"deviation, more than {MOST}; give images as it will see them, or more of them"
            )
        out.parent.mkdir(parents=True, exist_ok=True)
        partial = out.with_suffix(".partial")
        partial.write_bytes(small.read_bytes())
        partial.replace(out)
    return agreement


def _policy(path: Path) -> tuple[onnx.ModelProto, dict[str, Any]]:
    """A file that `export` made, all its weights in 32 bits."""
    try:
        model = onnx.load(str(path))
        contract = json.loads({entry.key: entry.value for entry in model.metadata_props}[CONTRACT_KEY])
    except OSError as error:
        raise QuantiseError(f"{path}: {error.strerror}") from error
    except (DecodeError, KeyError, ValueError) as error:
        raise QuantiseError(f"{path} is no policy that `goshawk train export` wrote") from error
    graph = model.graph
    if any(node.op_type == "DequantizeLinear" for node in graph.node):
        raise QuantiseError(f"{path} calculates in 8 bits already")
    kept = {weight.name: weight for weight in graph.initializer}
    for cast_up in [node for node in graph.node if node.op_type == "Cast" and node.input[0] in kept]:
        half = kept[cast_up.input[0]]
        whole = onnx.numpy_helper.to_array(half).astype(np.float32)
        graph.initializer.append(onnx.numpy_helper.from_array(whole, cast_up.output[0]))
        graph.initializer.remove(half)
        graph.node.remove(cast_up)
    return model, contract


def _images(data: Path, contract: dict[str, Any], *, frames: int) -> Iterator[F32]:
    """`frames` images from all scenes, as the network sees them, [1, 4, H, W]."""
    view, image = read_view(data), contract["image"]
    if (view.width, view.height) != (image["width"], image["height"]):
        size = f"{image['width']} x {image['height']}"
        raise QuantiseError(f"{data} has images of {view.width} x {view.height}, the policy sees {size}")
    depth = DepthConfig(**contract["depth"])
    folders = scene_folders(data)
    of_scene = -(-frames // len(folders))
    left = frames
    for folder in folders:
        count = len(read_labels(folder / "labels.csv", 0))
        rgb_MHW3, depth_MHW = read_images(folder, count, view)
        for at in np.unique(np.linspace(0, count - 1, min(of_scene, left, count)).round().astype(int)):
            yield rgbd_tensor(rgb_MHW3[at], depth_MHW[at], height=view.height, width=view.width, config=depth)[None]
            left -= 1


def _agreement(plain: Path, small: Path, images: list[F32], states: list[F32], channels: list[str]) -> Agreement:
    """On every second image, which is none that the ranges are of."""
    calibrated, images, states = len(images[::2]), images[1::2], states[1::2]
    if not images:
        raise QuantiseError("no image is left to compare by: give a larger data set")

    def answers(path: Path) -> F32:
        session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        run = cast("Any", session).run
        asked = [{"rgbd": image, "state": state} for image, state in zip(images, states, strict=True)]
        return np.stack([cast("F32", run(["prediction"], inputs)[0][0]) for inputs in asked])

    before, after = answers(plain), answers(small)
    apart = np.sqrt(np.mean((after - before) ** 2, axis=(0, 2, 3)))
    spread = np.maximum(before.std(axis=(0, 2, 3)), 1e-6)
    cost = channels.index("cost")
    was, now = (answer[:, cost].reshape(len(images), -1).argmin(axis=1) for answer in (before, after))
    return Agreement(
        calibrated=calibrated,
        images=len(images),
        differences=dict(zip(channels, (apart / spread).tolist(), strict=True)),
        same_choice=float((was == now).mean()),
    )
