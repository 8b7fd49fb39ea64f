"""Data sets on disk (`layout`) to arrays in memory and batches.

Shape letters: M frames of a scene, F frames of all scenes, B batch, H, W, 3 an FLU or ENU vector, S state.
The "net" frame is the camera frame, or its mirror image left to right for mirrored samples.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from goshawk_train.config import CameraConfig, Config
from goshawk_train.costs.batch import Batch, Situation
from goshawk_train.costs.esdf import ESDF_VERSION, SceneGrid, SceneMaps, grid_from_points
from goshawk_train.data import DataError, augment, preprocess, sampling
from goshawk_train.data.layout import (
    Labels,
    read_ground,
    read_images,
    read_labels,
    read_obstacles,
    read_view,
    scene_folders,
)
from goshawk_train.data.shards import Images, Shards
from goshawk_train.model import geometry

F64 = NDArray[np.float64]
CPU = torch.device("cpu")
WHOLE = slice(None)


@dataclass(frozen=True, kw_only=True)
class Frames:
    """All frames of a data set: images as integers, depth filled."""

    rgb_FHW3: Images
    depth_FHW: Images
    labels: Labels

    def __len__(self) -> int:
        return len(self.rgb_FHW3)


def _cached_distance(folder: Path, low: F64, high: F64) -> tuple[NDArray[np.float16], F64]:
    """The distance field, mapped from `esdf.npy` beside the points; made first when absent or older than they are."""
    points, cache, about = folder / "environment.ply", folder / "esdf.npy", folder / "esdf.json"
    if about.exists() and cache.exists() and about.stat().st_mtime >= points.stat().st_mtime:
        with suppress(EOFError, KeyError, TypeError, ValueError):  # damaged: it is made anew
            stored = json.loads(about.read_text())
            if stored["version"] == ESDF_VERSION:
                return np.load(cache, mmap_mode="r"), np.array(stored["origin"])
    distance, origin = grid_from_points(read_obstacles(folder), min_xyz=low, max_xyz=high)
    mine = secrets.token_hex(4)  # another run may be at it, too, on another machine
    partial, partial_about = folder / f"esdf.{mine}.partial.npy", folder / f"esdf.{mine}.partial.json"
    try:
        np.save(partial, distance.astype(np.float16))
        partial.replace(cache)
        partial_about.write_text(json.dumps({"version": ESDF_VERSION, "origin": origin.tolist()}))
        partial_about.replace(about)
    finally:
        for left in (partial, partial_about):
            left.unlink(missing_ok=True)
    return np.load(cache, mmap_mode="r"), origin


def read_grid(folder: Path) -> SceneGrid:
    """One scene's privileged map; raises `DataError`."""
    ground, bounds = read_ground(folder)
    distance, origin = _cached_distance(folder, bounds.min_xyz, bounds.max_xyz)
    return SceneGrid(
        distance_XYZ=distance,
        distance_origin=origin,
        ground_XY=np.ascontiguousarray(ground.height_YX.T),
        ground_origin=ground.min_xy,
        ground_cell_m=ground.cell_m,
    )


def _scenes(root: Path, camera: CameraConfig) -> list[Path]:
    """The scenes of a data set of this camera; raises `DataError`."""
    folders, view = scene_folders(root), read_view(root)
    if (view.width, view.height) != (camera.width, camera.height) or abs(view.hfov_rad - camera.hfov_rad) > 1e-3:
        raise DataError(
            f"{root}/dataset.json: images are {view.width} x {view.height} at {view.hfov_rad:.4f} rad across, the "
            f"configuration says {camera.width} x {camera.height} at {camera.hfov_rad:.4f}; use another configuration"
        )
    return folders


def load(
    root: Path, config: Config, *, also: Sequence[Path] = (), stream: bool = False, workers: int = 2
) -> tuple[Frames, SceneMaps]:
    """Read a whole data set, and others `also` as if they were part of it; depth is filled once here. A `stream` leaves
    the images on disk, to be read and filled when a batch needs them. Raises `DataError`."""
    folders, view = [folder for one in (root, *also) for folder in _scenes(one, config.camera)], read_view(root)
    parts = [read_labels(folder / "labels.csv", scene) for scene, folder in enumerate(folders)]
    fields = Labels.__dataclass_fields__
    labels = Labels(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in fields})
    size = (view.height, view.width)
    if stream:
        mapped = [read_images(folder, len(part), view) for folder, part in zip(folders, parts, strict=True)]
        rgb, depth = zip(*mapped, strict=True)
        with ThreadPoolExecutor(workers) as pool:
            grids = list(pool.map(read_grid, folders))
        filled = Shards(depth, lambda measured: preprocess.fill_depth(measured, config.depth))
        return Frames(rgb_FHW3=Shards(rgb), depth_FHW=filled, labels=labels), SceneMaps(grids)
    rgb_FHW3 = np.empty((len(labels.scene_F), *size, 3), dtype=np.uint8)
    depth_FHW = np.empty((len(labels.scene_F), *size), dtype=np.uint16)
    starts = np.cumsum([0] + [len(part) for part in parts])

    def one(scene: int) -> SceneGrid:
        folder, here = folders[scene], slice(starts[scene], starts[scene + 1])
        rgb, depth = read_images(folder, len(parts[scene]), view)
        rgb_FHW3[here] = rgb
        depth_FHW[here] = preprocess.fill_depth(np.asarray(depth), config.depth)
        return read_grid(folder)

    with ThreadPoolExecutor(workers) as pool:
        grids = list(pool.map(one, range(len(folders))))
    return Frames(rgb_FHW3=rgb_FHW3, depth_FHW=depth_FHW, labels=labels), SceneMaps(grids)


def epoch_order(frames: int, *, seed: int, epoch: int) -> NDArray[np.int64]:
    """The order of an epoch, a pure function of its number: resuming needs no saved generator."""
    return np.random.default_rng([seed, 1, epoch]).permutation(frames)


def _images(
    frames: Frames, index_I: NDArray[np.int64], mirrored_I: NDArray[np.bool_], config: Config, device: torch.device
) -> Tensor:
    """[I, H, W, 4] in 0..1."""
    rgb, depth = frames.rgb_FHW3[index_I], frames.depth_FHW[index_I]
    rgb[mirrored_I] = rgb[mirrored_I, :, ::-1]
    depth[mirrored_I] = depth[mirrored_I, :, ::-1]
    rgbd = torch.empty(len(index_I), config.camera.height, config.camera.width, 4, device=device)
    rgbd[..., :3] = torch.from_numpy(rgb).to(device)
    rgbd[..., :3] /= 255
    rgbd[..., 3] = torch.from_numpy(preprocess.normalise_depth(depth, config.depth)).to(device)
    return rgbd


def make_batch(
    frames: Frames,
    index_I: NDArray[np.int64],
    rng: np.random.Generator,
    config: Config,
    *,
    training: bool,
    states: int = 1,
    part: slice = WHOLE,
    device: torch.device = CPU,
) -> Batch:
    """Frames with fresh random states, `states` each; with colour changes, blanking and mirroring when `training`.

    Of a `part` of the frames alone it is the same part of the batch, bit for bit: random numbers are drawn for all.

    Images go to the device as the integers that they are, and become numbers there.
    """
    images, labels = len(index_I), frames.labels
    mirrored = rng.uniform(size=images) < (config.augment.flip if training else 0.0)
    rgbd = _images(frames, index_I[part], mirrored[part], config, device)
    if training:
        rgbd = augment.augment(rgbd, rng, config.augment, count=images, part=part)

    count, index_B, mirrored = images * states, index_I.repeat(states), mirrored.repeat(states)
    mirror = np.ones((count, 1, 3))
    mirror[mirrored, 0, 1] = -1
    world_from_cam = labels.world_from_cam_F33[index_B]
    net_from_level = np.swapaxes(geometry.level_from_cam(world_from_cam) * mirror, 1, 2)
    world_from_net = world_from_cam * mirror

    def to_net(vector_B3: F64, net_from: F64) -> F64:
        return np.einsum("bij,bj->bi", net_from, vector_B3)

    velocity = to_net(sampling.sample_velocity(rng, count, config.sampling), net_from_level)
    agility = sampling.sample_agility(rng, count, config.sampling)[:, None]
    acceleration = to_net(agility * sampling.sample_acceleration(rng, count, config.sampling), net_from_level)
    pos = labels.pos_world_F3[index_B]
    net_from_world = np.swapaxes(world_from_net, 1, 2)
    aim = sampling.sample_aim(rng, pos[:, 2] - labels.ground_F[index_B], config.reach_m, config.sampling)
    aim = to_net(aim, net_from_level)
    has_target = labels.has_target_F[index_B] & (config.task == "track")
    known = has_target | np.isnan(labels.visible_F[index_B])
    visible = np.where(known, labels.visible_F[index_B], 0.0)
    target_rel = np.where(has_target[:, None], labels.target_world_F3[index_B] - pos, 0.0)
    chases = has_target & (rng.uniform(size=count) < config.sampling.chase)
    chase = to_net(sampling.chase_aim(rng, target_rel, config.sampling), net_from_world)
    aim = np.where(chases[:, None], chase, aim)
    if "aim" in config.network.state:
        aim = sampling.within_reach(aim, config.reach_m)

    first, behind, _ = part.indices(images)
    samples = slice(first * states, behind * states)

    def tensor(value: NDArray[Any]) -> Tensor:
        return torch.as_tensor(np.ascontiguousarray(value[samples], dtype=np.float32))

    state = {
        "velocity": velocity,
        "acceleration": acceleration,
        "up": world_from_net[:, 2],
        "aim": aim / config.reach_m,
        "direction": aim / np.maximum(np.linalg.norm(aim, axis=1, keepdims=True), 1e-6),
        "agility": agility,
    }
    return Batch(
        rgbd_I4HW=rgbd.permute(0, 3, 1, 2),
        state_BS=tensor(np.concatenate([state[name] for name in config.network.state], axis=1)),
        velocity_net_B3=tensor(velocity * config.motion.v_max_mps),
        acceleration_net_B3=tensor(acceleration * config.motion.a_max_mps2),
        world_from_net_B33=tensor(world_from_net),
        target_net_B3=tensor(to_net(target_rel, net_from_world)),
        visible_B=tensor(visible),
        situation=Situation(
            pos_world_B3=tensor(pos),
            scene_B=torch.from_numpy(labels.scene_F[index_B[samples]]),
            aim_rel_B3=tensor(to_net(aim, world_from_net)),
            agility_B=tensor(agility[:, 0]),
        ),
    ).to(device)
