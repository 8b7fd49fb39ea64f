"""Distance fields, ground heights and data files."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from goshawk_train.config import Config
from goshawk_train.costs.esdf import (
    DEEP_VOXELS,
    FAR_VOXELS,
    VOXEL_M,
    SceneGrid,
    SceneMaps,
    grid_from_points,
    signed_distance,
)
from goshawk_train.data import DataError, batches
from numpy.typing import NDArray


def brute_force(occupied: NDArray[np.bool_]) -> NDArray[np.float64]:
    centres: NDArray[np.int64] = np.indices(occupied.shape).reshape(3, -1).T
    flags = occupied.ravel()
    to_occupied: NDArray[np.float64] = np.linalg.norm(centres[:, None] - centres[flags][None], axis=2).min(1)
    to_free: NDArray[np.float64] = np.linalg.norm(centres[:, None] - centres[~flags][None], axis=2).min(1)
    inside = 1 - np.minimum(to_free, DEEP_VOXELS)
    outside: NDArray[np.float64] = np.minimum(to_occupied, FAR_VOXELS)
    return VOXEL_M * np.where(flags, inside, outside).reshape(occupied.shape)


def test_signed_distance_equals_brute_force() -> None:
    rng = np.random.default_rng(0)
    occupied = rng.uniform(size=(9, 8, 7)) < 0.1
    occupied[2:6, 2:6, 2:6] = True
    np.testing.assert_allclose(signed_distance(occupied, voxel_m=VOXEL_M), brute_force(occupied), atol=1e-6)


def test_distance_to_a_trunk_is_right_within_half_a_voxel() -> None:
    axis = np.arange(-20, 20) * VOXEL_M + 0.1
    x, y, z = np.meshgrid(axis, axis, axis[:10], indexing="ij")
    gap = np.hypot(x - 0.03, y + 0.04) - 0.3
    points = np.column_stack([v[gap < 0.1] for v in (x, y, z)]).astype(np.float32)
    low, high = np.array([-4.0, -4.0, -4.0]), np.array([4.0, 4.0, -2.0])
    distance, origin = grid_from_points(points, min_xyz=low, max_xyz=high)
    grid = SceneGrid(
        distance_XYZ=distance,
        distance_origin=origin,
        ground_XY=np.zeros((3, 3), dtype=np.float32),
        ground_origin=low[:2],
        ground_cell_m=4.0,
    )
    probe = np.random.default_rng(1).uniform([-3, -3, -3.8], [3, 3, -2.4], (500, 3))
    true = np.hypot(probe[:, 0] - 0.03, probe[:, 1] + 0.04) - 0.3
    got = SceneMaps([grid]).clearance(torch.tensor(probe), torch.zeros(500, dtype=torch.long)).numpy()
    near = (true > 0) & (true < 3.0)
    assert np.abs(got - true)[near].max() < 0.13
    assert abs((got - true)[near].mean()) < 0.04


def test_second_scene_is_looked_up_in_its_own_grid() -> None:
    grids: list[SceneGrid] = []
    for value, shape in ((1.0, (4, 5, 6)), (2.0, (7, 3, 4))):
        grids.append(
            SceneGrid(
                distance_XYZ=np.full(shape, value, dtype=np.float32),
                distance_origin=np.zeros(3),
                ground_XY=np.full((3, 4), 10 * value, dtype=np.float32),
                ground_origin=np.zeros(2),
                ground_cell_m=0.5,
            )
        )
    maps = SceneMaps(grids)
    point = torch.tensor([[0.3, 0.3, 0.3], [0.3, 0.3, 0.3], [99.0, -99.0, 99.0]])
    scene = torch.tensor([0, 1, 1])
    assert maps.clearance(point, scene).tolist() == [1.0, 2.0, 2.0]
    assert maps.ground(point, scene).tolist() == [10.0, 20.0, 20.0]


def test_ground_is_bilinear() -> None:
    x, y = np.meshgrid(np.arange(5) * 0.5 - 1, np.arange(4) * 0.5 + 2, indexing="ij")
    grid = SceneGrid(
        distance_XYZ=np.ones((2, 2, 2), dtype=np.float32),
        distance_origin=np.zeros(3),
        ground_XY=(0.3 * x - 0.2 * y).astype(np.float32),
        ground_origin=np.array([-1.0, 2.0]),
        ground_cell_m=0.5,
    )
    point = torch.tensor([[-0.7, 2.9, 0.0], [0.55, 2.1, 0.0]], dtype=torch.float64)
    got = SceneMaps([grid]).ground(point, torch.zeros(2, dtype=torch.long))
    torch.testing.assert_close(got, 0.3 * point[:, 0] - 0.2 * point[:, 1], rtol=0, atol=1e-6)


def test_scene_without_obstacles_is_far_from_everything() -> None:
    box = np.zeros(3), np.ones(3)
    distance, _ = grid_from_points(np.zeros((0, 3), dtype=np.float32), min_xyz=box[0], max_xyz=box[1])
    assert distance.min() == pytest.approx(3.2)


def test_missing_dataset_says_how_to_make_one(config: Config, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="goshawk-sim dataset"):
        batches.load(tmp_path, config)


@pytest.mark.parametrize("name", ["esdf.npy", "esdf.json"])
def test_a_damaged_distance_field_is_made_anew(name: str, dataset: Path, config: Config, tmp_path: Path) -> None:
    root = shutil.copytree(dataset, tmp_path / "data")
    batches.load(root, config)
    damaged = root / "scene_0000" / name
    whole = damaged.read_bytes()
    for torn in (b"", whole[:40], b"[]"):
        damaged.write_bytes(torn)
        batches.load(root, config)
        assert damaged.read_bytes() == whole
    assert len(list(damaged.parent.glob("*.partial.*"))) == 0
