"""How long a network takes by itself on one thread, against what the core can do.

    python network.py

For the shipped chase and the paper's, by the processor and, after `make setup-openvino`, by OpenVINO in 16 bits. The
yardsticks are of the same run: a large product of matrices by the same ONNX Runtime, which is as fast as a core
multiplies, and one reading of as many bytes as the shipped weights have, which are read for each image. The keys:
`network_roofline` (share of the limit, on the processor) and `network_ms` (by network and provider).
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
MODELS = {"shipped": "air/models/track.onnx", "paper": "air/models/paper.onnx"}
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

    found = {"cpu": child("cpu", {})}
    if OPENVINO.is_dir():
        found["openvino, 16 bits"] = child("openvino", {"PYTHONPATH": str(OPENVINO)})
    else:
        print("OpenVINO is not timed: make setup-openvino")
    multiplies = 1e3 * SIDE**3 / found["cpu"].pop("product")
    reads = 1e3 * work(ROOT / MODELS["shipped"])[1] / found["cpu"].pop("reading")
    print(f"the network alone, one thread, median of {RUNS}; this core multiplies {2e-9 * multiplies:.0f} GFLOP/s")
    shares = dict[str, float]()
    for name, path in MODELS.items():
        count, size = work(ROOT / path)
        limits_ms = 1e3 * count / multiplies, 1e3 * size / reads
        took_ms = found["cpu"][name]
        shares[name] = max(limits_ms) / took_ms
        print(
            f"  {name:<8} {took_ms:6.2f} ms by the processor: {1e-6 * count:.0f} million multiply-adds want"
            f" {limits_ms[0]:.2f} ms, reading {1e-6 * size:.0f} MB of weights {limits_ms[1]:.2f} ms:"
            f" {shares[name]:.0%} of the limit"
        )
        for provider, times in list(found.items())[1:]:
            print(f"  {name:<8} {times[name]:6.2f} ms by {provider}")
    least_ms = min(times["paper"] for times in found.values())
    print(f"  the paper's at its fastest {least_ms:.2f} ms   target {PAPER_MS:g}: {verdict(least_ms <= PAPER_MS)}")
    record("network_roofline", {name: round(share, 2) for name, share in shares.items()})
    rounded = {provider: {name: round(ms, 3) for name, ms in times.items()} for provider, times in found.items()}
    record("network_ms", rounded)


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
        given: dict[str, Any] = {i.name: rng.random(i.shape, dtype=np.float32) for i in session.get_inputs()}
        return median_ms(lambda: session.run(None, given))

    seen = {name: timed(str(ROOT / path)) for name, path in MODELS.items()}
    if provider != "cpu":
        return seen
    numbers = np.ones(work(ROOT / MODELS["shipped"])[1] // 4, dtype=np.float32)
    return seen | {"product": timed(product()), "reading": median_ms(lambda: numbers.dot(numbers))}


def median_ms(do: Callable[[], object]) -> float:
    """After some runs that are not counted."""
    took: list[float] = []
    for _ in range(RUNS // 10 + RUNS):
        begun = time.perf_counter()
        do()
        took.append(time.perf_counter() - begun)
    return 1e3 * float(np.median(took[RUNS // 10 :]))


def product() -> bytes:
    """A model that multiplies a matrix by another."""
    from onnx import TensorProto, helper, numpy_helper

    weights = numpy_helper.from_array(np.random.default_rng(2).random((SIDE, SIDE), dtype=np.float32), "b")
    ends = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [SIDE, SIDE]) for name in "ac"]
    graph = helper.make_graph([helper.make_node("MatMul", ["a", "b"], ["c"])], "product", ends[:1], ends[1:], [weights])
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
