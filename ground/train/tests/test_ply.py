"""Point clouds: what scanners and simulators write is read, what is torn is named."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from goshawk_train.data import DataError
from goshawk_train.data.ply import read_ply, write_ply
from goshawk_train.data.raymap import voxel_centres

POINTS = np.array([[1.5, -2.0, 0.25], [0.0, 3.0, -1.0]], dtype=np.float32)
HEAD = "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n"


def test_what_is_written_is_read(tmp_path: Path) -> None:
    write_ply(tmp_path / "x.ply", POINTS)
    assert np.array_equal(read_ply(tmp_path / "x.ply"), POINTS)


@pytest.mark.parametrize("order", ["<", ">"])
def test_doubles_colours_and_faces_are_no_hindrance(tmp_path: Path, order: str) -> None:
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    head = f"ply\nformat {name} 1.0\ncomment a scanner\nelement vertex 2\nproperty uchar red\nproperty double x\n"
    head += "property double y\nproperty float nx\nproperty double z\nelement face 1\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    body = b"".join(struct.pack(f"{order}Bddfd", 7, x, y, 0.5, z) for x, y, z in POINTS.tolist())
    (tmp_path / "x.ply").write_bytes(head.encode() + body + struct.pack(f"{order}B3i", 3, 0, 1, 0))
    assert np.array_equal(read_ply(tmp_path / "x.ply"), POINTS)


def test_text_is_read(tmp_path: Path) -> None:
    (tmp_path / "x.ply").write_text(f"ply\nformat ascii 1.0\n{HEAD}end_header\n1.5 -2 0.25\n0 3 -1\n")
    assert np.array_equal(read_ply(tmp_path / "x.ply"), POINTS)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "not a PLY"),
        ("ply\n", "not a PLY"),
        ("ply\nformat ascii 1.0\nend_header\n", "first element is vertex"),
        ("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n", "without x, y, z"),
        (f"ply\nformat ascii 1.0\n{HEAD}end_header\n1 2 3\n", "truncated: 1 lines for 2 points"),
        (f"ply\nformat ascii 1.0\n{HEAD}end_header\n1 2 3\na b c\n", "x.ply"),
        ("ply\nformat\nelement vertex 2\nend_header\n", "not a PLY point cloud"),
        ("ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "not a PLY point cloud"),
        (f"ply\nformat ascii 1.0\n{HEAD}end_header\n1 2\n3 4\n", "invalid column"),
        (f"ply\nformat binary_little_endian 1.0\n{HEAD}end_header\n0123456789ab", "truncated: 12 bytes for 2 points"),
    ],
)
def test_what_is_no_cloud_is_named(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "x.ply").write_text(text)
    with pytest.raises(DataError, match=said) as caught:
        read_ply(tmp_path / "x.ply")
    assert "x.ply" in str(caught.value)


def test_voxels_have_one_centre_each_on_the_grid() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(-3, 3, (5000, 3))
    centres = voxel_centres(points)
    assert len(np.unique(centres, axis=0)) == len(centres)
    np.testing.assert_allclose(centres / 0.2 - 0.5, np.rint(centres / 0.2 - 0.5), atol=1e-4)
    for point in points[:200]:
        assert np.abs(centres - point).max(axis=1).min() <= 0.1 + 1e-6
