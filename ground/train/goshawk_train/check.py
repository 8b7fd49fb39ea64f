"""Is a data set fit to train on? Checks before hours are spent: counts, poses, and images against the map."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from goshawk_train import data, geometry
from goshawk_train.config import Config


def check(root: Path, config: Config, *, frames_checked: int = 100) -> tuple[dict[str, float], list[str]]:
    """Figures of a data set and what is wrong with it (empty: nothing). Raises `data.DataError`.

    `surface_share` back-projects measured depth nearer than 8 m to the world: the share that lies on an obstacle, on
    the ground or on the target. It is small when poses, frames or maps do not fit the images.
    """
    frames, maps = data.load(root, config)
    labels = frames.labels
    pos = torch.as_tensor(labels.pos_world_F3, dtype=torch.float32)
    clearance = maps.clearance(pos, torch.from_numpy(labels.scene_F)).numpy()
    above = labels.pos_world_F3[:, 2] - labels.ground_F
    ground = maps.ground(pos, torch.from_numpy(labels.scene_F)).numpy()
    figures = {
        "scenes": float(labels.scene_F.max() + 1),
        "frames": float(len(frames)),
        "target_share": float(labels.has_target_F.mean()),
        "visible_share": float((labels.visible_F >= config.assign.visible_min).mean()),
        "clearance_min_m": float(clearance.min()),
        "clearance_p5_m": float(np.percentile(clearance, 5)),
        "height_min_m": float(above.min()),
        "height_median_m": float(np.median(above)),
        "ground_difference_max_m": float(np.abs(ground - labels.ground_F).max()),
        "surface_share": _surface_share(frames, maps, config, frames_checked),
    }
    problems = []
    if figures["clearance_min_m"] < 0:
        problems.append(f"{int((clearance < 0).sum())} camera poses lie inside obstacles")
    if figures["height_min_m"] < 0:
        problems.append(f"{int((above < 0).sum())} camera poses lie under the ground")
    if figures["ground_difference_max_m"] > 0.3:
        problems.append("ground_z and ground.npy differ; are the axes of ground.npy [y, x]?")
    if figures["surface_share"] < 0.8:
        problems.append("measured depth does not lie on the map's surfaces; do poses and maps fit the images?")
    if config.task == "track" and figures["visible_share"] < 0.2:
        problems.append("fewer than a fifth of the frames show the target")
    return figures, problems


def _surface_share(frames: data.Frames, maps: data.SceneMaps, config: Config, count: int) -> float:
    rng = np.random.default_rng(0)
    rays = geometry.pixel_rays(config.camera).reshape(-1, 3)
    labels, on, total = frames.labels, 0, 0
    for index in rng.choice(len(frames), min(count, len(frames)), replace=False):
        depth = frames.depth_FHW[index].reshape(-1) / 1000
        pixel = rng.choice(len(depth), 400, replace=False)
        pixel = pixel[depth[pixel] < 8]
        pos_cam = rays[pixel] * depth[pixel, None]
        pos = pos_cam @ labels.world_from_cam_F33[index].T + labels.pos_world_F3[index]
        point = torch.as_tensor(pos, dtype=torch.float32)
        scene = torch.full((len(point),), int(labels.scene_F[index]))
        near = np.abs(maps.clearance(point, scene).numpy()) < 0.4
        near |= np.abs(pos[:, 2] - maps.ground(point, scene).numpy()) < 0.3
        if labels.has_target_F[index]:
            near |= np.hypot(*(pos - labels.target_world_F3[index])[:, :2].T) < 0.7
        on, total = on + int(near.sum()), total + len(near)
    return on / max(total, 1)
