"""How many images of depth Embree casts a second on one core, of the scene that the renderer's benchmark has left.

    python embree.py

The renderer also draws colour; it is to be three times as fast. The key: `render_against_embree`.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "ground/station/benches"))

from common import BENCH_JSON, record, verdict  # noqa: E402

SCENE = ROOT / "target/render"
TARGET = 3.0
ROUNDS = 5
FARTHEST_M = 30.0


def main() -> None:
    """Measures and records."""
    try:
        camera: dict[str, float] = json.loads((SCENE / "camera.json").read_text())
        triangles_T33 = np.fromfile(SCENE / "triangles.f32", dtype="<f4").reshape(-1, 3, 3)
        poses_P43 = np.fromfile(SCENE / "poses.f32", dtype="<f4").reshape(-1, 4, 3)
        renderer_fps = json.loads(BENCH_JSON.read_text())["render_fps_per_core"]
    except (OSError, KeyError) as error:
        raise SystemExit(f"no scene ({error}): cargo bench --workspace --bench render leaves it") from error
    width, height, focal_px = int(camera["width"]), int(camera["height"]), camera["focal_px"]
    u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    ray_R3 = np.stack([np.full(u.size, focal_px), 0.5 * width - u.ravel(), 0.5 * height - v.ravel()], axis=1)
    ray_R3 /= np.linalg.norm(ray_R3, axis=1, keepdims=True)
    # It has no types.
    scene: Any = importlib.import_module("embreex.rtcore_scene").EmbreeScene()
    importlib.import_module("embreex.mesh_construction").TriangleMesh(scene, triangles_T33)
    fps: list[float] = []
    seen = 0.0
    for _ in range(ROUNDS):
        spent_s = 0.0
        for pos_3, world_from_cam_33 in zip(poses_P43[:, 0], poses_P43[:, 1:], strict=True):
            dir_R3 = (ray_R3 @ world_from_cam_33.T).astype(np.float32)
            origin_R3 = np.repeat(pos_3[None], len(dir_R3), axis=0)
            begun = time.thread_time()
            far_m_R = scene.run(origin_R3, dir_R3, query="DISTANCE")
            spent_s += time.thread_time() - begun
            seen += float((far_m_R < FARTHEST_M).mean())
        fps.append(len(poses_P43) / spent_s)
    share = seen / (ROUNDS * len(poses_P43))
    if share < 0.5:
        raise SystemExit(f"Embree sees {share:.0%} of the pixels: that is another scene")
    embree_fps = float(np.median(fps))
    ratio = renderer_fps / embree_fps
    print(
        f"Embree, {width} x {height} depth, {len(triangles_T33)} triangles, one core: {embree_fps:.0f} frames/s; the"
        f" renderer's {renderer_fps:.0f} are {ratio:.1f} x   target {TARGET:g}: {verdict(ratio >= TARGET)}"
    )
    record("render_against_embree", {"ratio": round(ratio, 1), "embree_fps": round(embree_fps, 1)})


if __name__ == "__main__":
    main()
