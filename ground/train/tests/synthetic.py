"""A tiny data set in the exact layout of `goshawk-sim dataset`: cylinders as trees and person, flat ground.

And the same in the layout of the public YOPO-Tracker; and a configuration as a file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import cast

import numpy as np
from goshawk_train.config import CameraConfig, Config, config_to_dict
from goshawk_train.data.layout import View
from goshawk_train.model import geometry
from numpy.typing import NDArray
from PIL import Image

F64 = NDArray[np.float64]

PERSON_RADIUS_M = 0.25
LOW = np.array([-14.0, -14.0, -0.6])
HIGH = np.array([14.0, 14.0, 4.4])


def _quaternion(yaw: float, pitch: float, roll: float) -> F64:
    """(w, x, y, z) of Rz(yaw) Ry(pitch) Rx(roll)."""
    cy, sy, cp, sp = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    cr, sr = np.cos(roll / 2), np.sin(roll / 2)
    return np.array(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )


def _cylinder(origin: F64, rays: F64, x: float, y: float, radius: float, top: float) -> F64:
    """Ray parameter of the hit with an upright cylinder on the ground, inf without one."""
    ox, oy = origin[0] - x, origin[1] - y
    a = rays[..., 0] ** 2 + rays[..., 1] ** 2
    b = ox * rays[..., 0] + oy * rays[..., 1]
    c = ox * ox + oy * oy - radius * radius
    square = b * b - a * c
    t = (-b - np.sqrt(np.maximum(square, 0))) / np.maximum(a, 1e-9)
    z = origin[2] + t * rays[..., 2]
    return np.where((square > 0) & (t > 0.05) & (z > 0) & (z < top), t, np.inf)


def _render(
    origin: F64, world_from_cam: F64, camera: CameraConfig | View, trees: F64, target: F64 | None
) -> tuple[NDArray[np.uint8], F64, float]:
    """Colours, depth along each pixel's ray, and the share of the target that is in sight."""
    rays = geometry.pixel_rays(camera) @ world_from_cam.T
    down = rays[..., 2] < -1e-6
    depth = np.where(down, -origin[2] / np.where(down, rays[..., 2], -1.0), np.inf)
    rgb = np.full((*depth.shape, 3), [110.0, 150.0, 200.0])
    rgb[np.isfinite(depth)] = [80, 110, 50]
    for x, y, radius in trees:
        hit = _cylinder(origin, rays, x, y, radius, 4.0)
        rgb[hit < depth] = [90, 60, 40]
        depth = np.minimum(depth, hit)
    visible = 0.0
    if target is not None:
        hit = _cylinder(origin, rays, target[0], target[1], PERSON_RADIUS_M, 1.75)
        seen = hit < depth
        if np.isfinite(hit).any():
            visible = float(seen.sum() / np.isfinite(hit).sum())
        rgb[seen] = [200, 40, 40]
        depth = np.minimum(depth, hit)
    return rgb.astype(np.uint8), depth, visible


def _write_ply(path: Path, points: F64) -> None:
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "property float x\nproperty float y\nproperty float z\nend_header\n"
    path.write_bytes(header.encode() + points.astype("<f4").tobytes())


def _trees(rng: np.random.Generator) -> F64:
    """x, y, radius of each."""
    return np.column_stack([rng.uniform(-13, 13, (30, 2)), rng.uniform(0.1, 0.35, 30)])


def _voxels(trees: F64) -> F64:
    axes = [np.arange(lo + 0.1, hi, 0.2) for lo, hi in zip(LOW, HIGH, strict=True)]
    centre = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    gap = np.hypot(centre[:, None, 0] - trees[:, 0], centre[:, None, 1] - trees[:, 1]) - trees[:, 2]
    return centre[(gap.min(axis=1) < 0.1) & (centre[:, 2] < 4.0)]


def _pose(rng: np.random.Generator, trees: F64) -> tuple[F64, F64, F64 | None]:
    """Position and quaternion of a camera, and a target two times out of three."""
    pos = np.array([*rng.uniform(-8, 8, 2), rng.uniform(0.8, 2.0)])
    while (np.hypot(trees[:, 0] - pos[0], trees[:, 1] - pos[1]) - trees[:, 2]).min() < 0.6:
        pos[:2] = rng.uniform(-8, 8, 2)
    yaw = rng.uniform(-np.pi, np.pi)
    quaternion = _quaternion(yaw, rng.normal(0, 0.12), rng.normal(0, 0.12))
    if rng.uniform() >= 0.67:
        return pos, quaternion, None
    bearing, away = yaw + rng.uniform(-0.6, 0.6), rng.uniform(1.5, 8.0)
    return pos, quaternion, np.array([pos[0] + away * np.cos(bearing), pos[1] + away * np.sin(bearing), 0.95])


def _measured_mm(rng: np.random.Generator, depth: F64) -> NDArray[np.uint16]:
    noisy = depth * (1 + 0.005 * depth * rng.normal(size=depth.shape))
    measured = (noisy > 0) & (noisy < 20) & (rng.uniform(size=depth.shape) > 0.02)
    return (np.where(measured, noisy, 0.0) * 1000).astype(np.uint16)


def write_dataset(root: Path, camera: CameraConfig, *, scenes: int, frames: int, seed: int) -> None:
    """Write `scenes` scenes of `frames` frames; about two thirds of the frames hold a person."""
    for scene in range(scenes):
        rng = np.random.default_rng([seed, scene])
        folder = root / f"scene_{scene:04d}"
        folder.mkdir(parents=True)
        trees = _trees(rng)
        _write_ply(folder / "environment.ply", _voxels(trees))
        np.save(folder / "ground.npy", np.zeros((57, 57), dtype=np.float32))
        meta = {"seed": seed, "spacing_m": 5.0, "min_xyz": LOW.tolist(), "max_xyz": HIGH.tolist()}
        meta |= {"ground_cell_m": 0.5, "ground_min_xy": LOW[:2].tolist(), "ground_shape": [57, 57]}
        (folder / "scene.json").write_text(json.dumps(meta))
        rgb = np.zeros((frames, camera.height, camera.width, 3), dtype=np.uint8)
        depth_mm = np.zeros((frames, camera.height, camera.width), dtype=np.uint16)
        lines = ["frame,x,y,z,qw,qx,qy,qz,target_x,target_y,target_z,visible,ground_z"]
        for frame in range(frames):
            pos, quaternion, target = _pose(rng, trees)
            world_from_cam = geometry.matrix_from_quaternion(quaternion)
            rgb[frame], depth, visible = _render(pos, world_from_cam, camera, trees, target)
            depth_mm[frame] = _measured_mm(rng, depth)
            cells = ["", "", ""] if target is None else [f"{c:.4f}" for c in target]
            numbers = [*pos, *quaternion]
            lines.append(",".join([str(frame), *(f"{n:.6f}" for n in numbers), *cells, f"{visible:.3f}", "0.0"]))
        np.save(folder / "rgb.npy", rgb)
        np.save(folder / "depth.npy", depth_mm)
        (folder / "labels.csv").write_text("\n".join(lines) + "\n")
    meta = {"version": 1, "width": camera.width, "height": camera.height, "hfov_rad": camera.hfov_rad}
    meta |= {"vfov_rad": camera.vfov_rad, "seed": seed, "scenes": scenes, "frames": frames, "commit": "synthetic"}
    (root / "dataset.json").write_text(json.dumps(meta))


def write_foreign(root: Path, *, scenes: int, frames: int, seed: int) -> None:
    """The same world in the public YOPO-Tracker's layout: 480 x 270 images, a cloud with ground, targets NaN if unseen.

    The names of the images are not padded, so that their order is that of numbers, not of text.
    """
    camera = View(width=480, height=270, hfov_rad=np.pi / 2)
    for scene in range(scenes):
        rng = np.random.default_rng([seed, scene])
        folder = root / f"scene-{scene}"
        for name in ("rgb", "depth"):
            (folder / name).mkdir(parents=True)
        trees = _trees(rng)
        flat = np.stack(np.meshgrid(np.arange(-14, 14, 0.15), np.arange(-14, 14, 0.15)), axis=-1).reshape(-1, 2)
        ground = np.column_stack([flat, rng.normal(0, 0.02, len(flat))])
        _write_ply(folder / "environment.ply", np.vstack([_voxels(trees), ground]))
        lines = ["px,py,pz,qw,qx,qy,qz,tx,ty,tz"]
        for frame in range(frames):
            pos, quaternion, target = _pose(rng, trees)
            rgb, depth, visible = _render(pos, geometry.matrix_from_quaternion(quaternion), camera, trees, target)
            Image.fromarray(rgb).save(folder / "rgb" / f"{frame}.jpg", quality=95)
            Image.fromarray(_measured_mm(rng, depth)).save(folder / "depth" / f"{frame}.png")
            seen = target if target is not None and visible > 0.8 else np.full(3, np.nan)
            lines.append(",".join(f"{n:.6f}" for n in [*pos, *quaternion, *seen]))
        (folder / "labels.csv").write_text("\n".join(lines) + "\n")


def write_config(config: Config, folder: Path) -> Path:
    """The configuration as a file."""
    path = folder / "small.toml"
    table = config_to_dict(config)
    lines = [f'task = "{table["task"]}"', f"seed = {table['seed']}"]
    for name, section in table.items():
        if isinstance(section, dict):
            lines.append(f"[{name}]")
            fields = cast("dict[str, object]", section)
            lines += [f"{k} = {json.dumps(v)}" for k, v in fields.items()]
    path.write_text("\n".join(lines))
    return path
