"""How long a network takes by itself on one thread, against what the core can do.

    python network.py

For the shipped chase and the paper's, in 8 bits as they fly and in 32 as they were trained, by the processor; and after
`make setup-openvino` those in 32 by OpenVINO in 16 bits. The paper's in 32 bits is too large to be kept: here it has
weights that nobody trained, with which it calculates as long. The yardsticks are of the same run: a large product of
matrices in as many bits by the same ONNX Runtime, which is as fast as a core multiplies, and one reading of as many
bytes as the shipped weights have, which are read for each image. The keys: `network_roofline` (share of the limit, on
the processor) and `network_ms` (by network and provider).
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
MODELS = {
    "shipped": "air/models/track.onnx",
    "shipped, 32 bits": "air/models/track-32bit.onnx",
    "paper": "air/models/paper.onnx",
    "paper, 32 bits": "target/paper-32bit.onnx",
}
WHOLE = ", 32 bits"
OPENVINO = ROOT / ".venv/openvino"
HALF = json.dumps({"CPU": {"INFERENCE_PRECISION_HINT": "bf16"}})
PAPER_MS = 4.0
"""The most that the paper's width may take, by whichever provider."""
SIDE = 1024
"""Of the matrices."""
RUNS = 200


def main() -> None:
    """Measures and records; with arguments it is the process that measures one provider."""
    if sys.argv[1:]:
        print(json.dumps(times_ms(sys.argv[1])))
        return
    sys.path.insert(0, str(ROOT / "ground/station/benches"))
    from common import record, verdict

    untrained(ROOT / "ground/train/configs/paper.toml", ROOT / MODELS["paper, 32 bits"])
    found = {"cpu": child("cpu", {})}
    if OPENVINO.is_dir():
        found["openvino, 16 bits"] = child("openvino", {"PYTHONPATH": str(OPENVINO)})
    else:
        print("OpenVINO is not timed: make setup-openvino")
    cpu = found["cpu"]
    multiplies = {bits: 1e3 * SIDE**3 / cpu.pop(f"product in {bits}") for bits in (8, 32)}
    reads = 1e3 * work(ROOT / MODELS["shipped" + WHOLE])[1] / cpu.pop("reading")
    rates = ", ".join(f"{2e-9 * rate:.0f} in {bits} bits" for bits, rate in multiplies.items())
    print(f"the network alone, one thread, median of {RUNS}; this core multiplies (Gop/s) {rates}")
    shares = dict[str, float]()
    for name in MODELS:
        count, size = work(ROOT / MODELS[name.removesuffix(WHOLE) + WHOLE])
        bits = 32 if name.endswith(WHOLE) else 8
        size = size * bits // 32
        limits_ms = 1e3 * count / multiplies[bits], 1e3 * size / reads
        shares[name] = max(limits_ms) / cpu[name]
        print(
            f"  {name:<17} {cpu[name]:6.2f} ms by the processor: {1e-6 * count:.0f} million multiply-adds want"
            f" {limits_ms[0]:.2f} ms, reading {1e-6 * size:.0f} MB of weights {limits_ms[1]:.2f} ms:"
            f" {shares[name]:.0%} of the limit"
        )
        for provider, times in list(found.items())[1:]:
            if name in times:
                print(f"  {name:<17} {times[name]:6.2f} ms by {provider}")
    least_ms = min(ms for times in found.values() for name, ms in times.items() if name.startswith("paper"))
    print(f"  the paper's at its fastest {least_ms:.2f} ms   target {PAPER_MS:g}: {verdict(least_ms <= PAPER_MS)}")
    record("network_roofline", {name: round(share, 2) for name, share in shares.items()})
    rounded = {provider: {name: round(ms, 3) for name, ms in times.items()} for provider, times in found.items()}
    record("network_ms", rounded)


def untrained(configuration: Path, path: Path) -> None:
    """Writes the network that a training begins with, as ONNX."""
    import torch
    from goshawk_train.config import load_config
    from goshawk_train.model.export import example_inputs
    from goshawk_train.model.network import Policy

    config = load_config(configuration)
    torch.onnx.export(
        Policy(config).eval(),
        example_inputs(config, 0),
        str(path),
        input_names=["rgbd", "state"],
        output_names=["prediction"],
        dynamo=True,
        external_data=False,
        verbose=False,
    )


def child(provider: str, environment: dict[str, str]) -> dict[str, float]:
    """One process can hold one ONNX Runtime."""
    command = [sys.executable, __file__, provider]
    done = subprocess.run(
        command,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"} | environment,
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


def times_ms(provider: str) -> dict[str, float]:
    """Of each network; on the processor of the yardsticks as well."""
    import onnxruntime as typeless

    onnxruntime: Any = typeless
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    asked: Any = {
        "cpu": ["CPUExecutionProvider"],
        "openvino": [("OpenVINOExecutionProvider", {"num_of_threads": "1", "load_config": HALF})],
    }[provider]

    def timed(model: str | bytes) -> float:
        session = onnxruntime.InferenceSession(model, options, providers=asked)
        if provider not in session.get_providers()[0].lower():
            raise SystemExit(f"{provider} does not run it here")
        rng = np.random.default_rng(1)
        given: dict[str, Any] = {
            i.name: rng.integers(0, 255, i.shape, dtype=np.uint8)
            if i.type == "tensor(uint8)"
            else rng.random(i.shape, dtype=np.float32)
            for i in session.get_inputs()
        }
        return median_ms(lambda: session.run(None, given))

    if provider != "cpu":
        return {name: timed(str(ROOT / path)) for name, path in MODELS.items() if name.endswith(WHOLE)}
    seen = {name: timed(str(ROOT / path)) for name, path in MODELS.items()}
    numbers = np.ones(work(ROOT / MODELS["shipped" + WHOLE])[1] // 4, dtype=np.float32)
    products = {f"product in {bits}": timed(product(bits)) for bits in (8, 32)}
    return seen | products | {"reading": median_ms(lambda: numbers.dot(numbers))}


def median_ms(do: Callable[[], object]) -> float:
    """After some runs that are not counted."""
    took: list[float] = []
    for _ in range(RUNS // 10 + RUNS):
        begun = time.perf_counter()
        do()
        took.append(time.perf_counter() - begun)
    return 1e3 * float(np.median(took[RUNS // 10 :]))


def product(bits: int) -> bytes:
    """A model that multiplies a matrix by another."""
    from onnx import TensorProto, helper, numpy_helper

    rng = np.random.default_rng(2)
    kind, given, result = "MatMul", TensorProto.FLOAT, TensorProto.FLOAT
    weights = rng.random((SIDE, SIDE), dtype=np.float32)
    if bits == 8:
        kind, given, result = "MatMulInteger", TensorProto.UINT8, TensorProto.INT32
        weights = rng.integers(-64, 64, (SIDE, SIDE), dtype=np.int8)
    first, last = (helper.make_tensor_value_info(n, t, [SIDE, SIDE]) for n, t in (("a", given), ("c", result)))
    held = [numpy_helper.from_array(weights, "b")]
    graph = helper.make_graph([helper.make_node(kind, ["a", "b"], ["c"])], "product", [first], [last], held)
    opset = [helper.make_opsetid("", 17)]
    return helper.make_model(graph, opset_imports=opset, ir_version=8).SerializeToString()


def work(path: Path) -> tuple[int, int]:
    """Multiply-adds of one run of a network, and bytes of its weights as they are calculated with."""
    import onnx
    from onnx import shape_inference

    model = shape_inference.infer_shapes(onnx.load(str(path)))
    shapes = {
        value.name: [d.dim_value for d in value.type.tensor_type.shape.dim]
        for value in [*model.graph.value_info, *model.graph.output, *model.graph.input]
    }
    shapes |= {weights.name: list(weights.dims) for weights in model.graph.initializer}
    count = 0
    for node in model.graph.node:
        if node.op_type == "Conv":
            count += math.prod(shapes[node.output[0]]) * math.prod(shapes[node.input[1]][1:])
        elif node.op_type == "Gemm":
            count += math.prod(shapes[node.input[1]])
    return count, 4 * sum(math.prod(weights.dims) for weights in model.graph.initializer)


if __name__ == "__main__":
    main()
