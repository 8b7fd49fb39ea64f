"""Preprocessing rules on tiny arrays; the same cases as JSON for the onboard side (`tests/vectors/preprocess.json`).

Regenerate the file with `python ground/train/tests/test_preprocess.py`.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from goshawk_train.config import DepthConfig
from goshawk_train.data import preprocess

VECTORS = Path(__file__).parents[3] / "tests" / "vectors" / "preprocess.json"
RULES = DepthConfig(min_m=0.2, max_m=20.0, fill_passes=2)


def reference_fill(depth: np.ndarray) -> np.ndarray:
    """The rule spelled out pixel by pixel, metres; independent of the vectorised code."""
    height, width = depth.shape
    value = [[d / 1000 if d >= 200 else None for d in row] for row in depth.tolist()]
    for _ in range(2):
        before = [list(row) for row in value]
        for i in range(height):
            for j in range(width):
                if before[i][j] is None:
                    rows, columns = range(max(0, i - 1), min(height, i + 2)), range(max(0, j - 1), min(width, j + 2))
                    around = [before[a][b] for a in rows for b in columns]
                    measured = [m for m in around if m is not None]
                    value[i][j] = min(measured) if measured else None
    return np.array([[min(20.0 if v is None else v, 20.0) / 20.0 for v in row] for row in value])


def cases() -> list[dict[str, Any]]:
    """Inputs and expected outputs, row-major; rgb [h][w][3] 0..255, outputs 0..1."""
    rng = np.random.default_rng(20)
    out: list[dict[str, Any]] = []
    for name, (height, width), (rows, columns) in (
        ("same_size", (6, 10), (6, 10)),
        ("half_size", (12, 20), (6, 10)),
        ("uneven_size", (9, 16), (6, 10)),
    ):
        depth = rng.integers(0, 26000, (height, width)).astype(np.uint16)
        depth[rng.uniform(size=depth.shape) < 0.5] = 0
        depth[: height // 2, width // 2 :] = 0  # a hole that two passes cannot close
        depth[0, 0], depth[-1, -1], depth[1, 0], depth[2, 0] = 199, 200, 65535, 20000
        rgb = rng.integers(0, 256, (height, width, 3)).astype(np.uint8)
        small = preprocess.resize_depth(depth, height=rows, width=columns)
        tensor = preprocess.rgbd_tensor(rgb, depth, height=rows, width=columns, config=RULES)
        out.append(
            {
                "name": name,
                "source": {"width": width, "height": height},
                "target": {"width": columns, "height": rows},
                "depth_mm": depth.ravel().tolist(),
                "rgb": rgb.ravel().tolist(),
                "expected_depth": np.round(reference_fill(small), 9).ravel().tolist(),
                "expected_rgb_planes": np.round(tensor[:3].astype(np.float64), 6).ravel().tolist(),
            }
        )
    return out


def document() -> str:
    """The JSON file's text."""
    about = (
        "depth: nearest source pixel under the target pixel's centre, then 2 fill passes with the 3x3 minimum, then"
        " clip at 20 m, / 20; rgb: area-weighted box average, rounded, / 255, planes R, G, B. Agree within 1e-5."
    )
    head = {"about": about, "depth": {"min_m": 0.2, "max_m": 20.0, "fill_passes": 2}}
    return json.dumps({**head, "cases": cases()}) + "\n"


def test_vectorised_fill_equals_the_rule_pixel_by_pixel() -> None:
    rng = np.random.default_rng(0)
    stack = rng.integers(0, 30000, (20, 7, 9)).astype(np.uint16)
    stack[rng.uniform(size=stack.shape) < 0.1] = 65535  # full scale is a measurement
    stack[rng.uniform(size=stack.shape) < 0.7] = 0
    got = preprocess.normalise_depth(preprocess.fill_depth(stack, RULES), RULES)
    np.testing.assert_allclose(got, np.stack([reference_fill(d) for d in stack]), atol=1e-7)


def test_nearer_than_20_cm_is_no_measurement() -> None:
    depth = np.array([[199, 200, 0, 0, 0, 0]], dtype=np.uint16)
    assert preprocess.fill_depth(depth, RULES).tolist() == [[200, 200, 200, 200, 20000, 20000]]


def test_fill_does_not_feed_on_itself_within_a_pass() -> None:
    depth = np.zeros((1, 8), dtype=np.uint16)
    depth[0, 0] = 1000
    assert (preprocess.fill_depth(depth, RULES)[0, :4] == [1000, 1000, 1000, 20000]).all()


def test_measurements_are_never_changed() -> None:
    depth = np.random.default_rng(1).integers(200, 20000, (8, 8)).astype(np.uint16)
    np.testing.assert_array_equal(preprocess.fill_depth(depth, RULES), depth)


def test_box_average_keeps_the_mean_of_uneven_sizes() -> None:
    rgb = np.random.default_rng(2).integers(0, 256, (9, 16, 3)).astype(np.uint8)
    small = preprocess.resize_rgb(rgb, height=6, width=10)
    np.testing.assert_allclose(small.mean((0, 1)), rgb.mean((0, 1)), rtol=1e-5)


def test_shared_vectors_are_those_of_this_code() -> None:
    assert json.loads(VECTORS.read_text()) == json.loads(document())


if __name__ == "__main__":
    VECTORS.write_text(document())
