"""The layout of a data set (`../README.md` has the table): what `goshawk-sim dataset` and the import write.

Shape letters: F frames, P points, H, W image rows and columns, Y, X nodes of the ground, 3 a world vector (ENU, m).
"""

from __future__ import annotations

import csv
import fcntl
import json
import math
import os
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data import DataError
from goshawk_train.data.ply import read_ply, write_ply
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

LABEL_COLUMNS = (
    *("frame", "x", "y", "z", "qw", "qx", "qy", "qz"),
    *("target_x", "target_y", "target_z", "visible", "ground_z"),
)
SCENE_FILES = ("rgb.npy", "depth.npy", "labels.csv", "environment.ply", "ground.npy", "scene.json")


@dataclass(frozen=True, kw_only=True)
class Labels:
    """Poses and targets of frames."""

    pos_world_F3: F64
    quaternion_F4: F64
    """(w, x, y, z) of world_from_cam as written; of unit length in a good data set."""
    world_from_cam_F33: F64
    target_world_F3: F64
    """0 where there is none."""
    has_target_F: NDArray[np.bool_]
    visible_F: F64
    """Share of the target that is seen; NaN where nobody knows whether there is one to be seen."""
    ground_F: F64
    scene_F: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.scene_F)


@dataclass(frozen=True, kw_only=True)
class View:
    """The camera of a data set's images: a pinhole with square pixels; what `geometry` needs of one."""

    width: int
    height: int
    hfov_rad: float

    @property
    def focal_px(self) -> float:
        """Focal length, px, the same on both axes."""
        return self.width / 2 / math.tan(self.hfov_rad / 2)

    @property
    def vfov_rad(self) -> float:
        """Vertical field of view."""
        return 2 * math.atan(self.height / 2 / self.focal_px)


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Heights of the ground at the nodes of a grid."""

    height_YX: NDArray[np.float32]
    min_xy: F64
    """World x, y of the first node."""
    cell_m: float

    def at(self, pos_P3: NDArray[np.floating[Any]]) -> F64:
        """Height under points [..., 3] (or [..., 2]), m: bilinear; beyond the grid that of its border."""
        coordinate = (pos_P3[..., :2] - self.min_xy) / self.cell_m
        last = np.array(self.height_YX.shape[::-1]) - 1
        clamped = np.clip(coordinate, 0, last)
        low = np.minimum(clamped.astype(np.int64), np.maximum(last - 1, 0))
        x, y = np.moveaxis(clamped - low, -1, 0)
        i, j = np.moveaxis(low, -1, 0)
        i1, j1 = np.minimum(i + 1, last[0]), np.minimum(j + 1, last[1])
        z = self.height_YX
        near, far = z[j, i] * (1 - x) + z[j, i1] * x, z[j1, i] * (1 - x) + z[j1, i1] * x
        return near * (1 - y) + far * y


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """The box of a scene."""

    min_xyz: F64
    max_xyz: F64


def read_labels(path: Path, scene: int) -> Labels:
    """One scene's `labels.csv`; raises `DataError`."""
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from error
    except (csv.Error, UnicodeDecodeError) as error:
        raise DataError(f"{path}: not a table: {error}") from error
    if not rows:
        raise DataError(f"{path}: no frames")

    def column(name: str, *, empty: float | None = None) -> F64:
        try:
            blank = np.array([r[name] == "" and empty is not None for r in rows])
            values = np.array([0.0 if b else float(r[name]) for r, b in zip(rows, blank, strict=True)])
        except (KeyError, TypeError, ValueError) as error:
            raise DataError(f"{path}: column {name}: {error}") from error
        if not np.isfinite(values).all():
            raise DataError(f"{path}: column {name} is not finite everywhere")
        return values if empty is None else np.where(blank, empty, values)

    quaternion = np.column_stack([column(n) for n in ("qw", "qx", "qy", "qz")])
    if not np.linalg.norm(quaternion, axis=1).all():
        raise DataError(f"{path}: a quaternion of zeros is no attitude")
    return Labels(
        pos_world_F3=np.column_stack([column(n) for n in "xyz"]),
        quaternion_F4=quaternion,
        world_from_cam_F33=geometry.matrix_from_quaternion(quaternion),
        target_world_F3=np.column_stack([column(f"target_{n}", empty=0.0) for n in "xyz"]),
        has_target_F=np.array([r["target_x"] != "" for r in rows]),
        visible_F=column("visible", empty=math.nan),
        ground_F=column("ground_z"),
        scene_F=np.full(len(rows), scene),
    )


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object; raises `DataError`."""
    try:
        value = json.loads(path.read_text())
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise DataError(f"{path}: not JSON: {error}") from error
    if not isinstance(value, dict):
        raise DataError(f"{path}: must hold a JSON object")
    return cast("dict[str, Any]", value)


def _field(path: Path, meta: dict[str, Any], name: str) -> Any:
    if name not in meta:
        raise DataError(f"{path}: {name} is missing")
    return meta[name]


def _vector(path: Path, meta: dict[str, Any], name: str, size: int) -> F64:
    try:
        value = np.atleast_1d(np.array(_field(path, meta, name), dtype=float))
    except (TypeError, ValueError) as error:
        raise DataError(f"{path}: {name} must be of {size} numbers") from error
    if value.shape != (size,) or not np.isfinite(value).all():
        raise DataError(f"{path}: {name} must be of {size} finite numbers, not {value.tolist()}")
    return value


def read_ground(folder: Path) -> tuple[Ground, Bounds]:
    """One scene's `ground.npy` and its box; raises `DataError` where they do not belong together."""
    about = folder / "scene.json"
    meta = read_json(about)
    low, high, origin = (
        _vector(about, meta, n, size) for n, size in (("min_xyz", 3), ("max_xyz", 3), ("ground_min_xy", 2))
    )
    cell = float(_vector(about, meta, "ground_cell_m", 1)[0])
    if not (low < high).all() or not cell > 0:
        raise DataError(f"{about}: the box {low} .. {high} or ground_cell_m {cell} is empty")
    height_YX = read_heights(folder / "ground.npy")
    ends = origin + cell * (np.array(height_YX.shape[::-1]) - 1)
    if (origin > low[:2] + cell).any() or (ends < high[:2] - cell).any():
        raise DataError(f"{folder}/ground.npy: {origin} .. {ends} does not cover {low[:2]} .. {high[:2]}")
    return Ground(height_YX=height_YX, min_xy=origin, cell_m=cell), Bounds(min_xyz=low, max_xyz=high)


def read_heights(path: Path) -> NDArray[np.float32]:
    """Heights of the ground [y, x]; raises `DataError`."""
    height_YX = read_array(path)
    if height_YX.dtype.kind not in "fiu" or height_YX.ndim != 2 or min(height_YX.shape) < 2:
        raise DataError(f"{path}: must be heights [y, x], not {height_YX.dtype} of shape {height_YX.shape}")
    if not np.isfinite(height_YX).all():
        raise DataError(f"{path}: must be finite heights")
    return height_YX.astype(np.float32)


def read_obstacles(folder: Path) -> NDArray[np.float32]:
    """One scene's obstacle points [P, 3]; raises `DataError`."""
    points_P3 = read_ply(folder / "environment.ply")
    if not np.isfinite(points_P3).all():
        raise DataError(f"{folder}/environment.ply: not all points are finite")
    return points_P3


def read_array(path: Path) -> NDArray[Any]:
    """An array file, mapped; raises `DataError`, also when it is shorter than it says."""
    try:
        found: Any = np.load(path, mmap_mode="r")
        if not isinstance(found, np.ndarray):
            raise ValueError("several arrays")
        return cast("NDArray[Any]", found)
    except FileNotFoundError as error:
        raise DataError(f"{path}: missing") from error
    except (OSError, ValueError, EOFError) as error:
        raise DataError(f"{path}: truncated, or not a NumPy array ({path.stat().st_size} bytes)") from error


def read_images(folder: Path, frames: int, view: View) -> tuple[NDArray[np.uint8], NDArray[np.uint16]]:
    """One scene's `rgb.npy` [F, H, W, 3] and `depth.npy` [F, H, W] in mm, mapped; raises `DataError`."""
    rgb, depth = read_array(folder / "rgb.npy"), read_array(folder / "depth.npy")
    shape = (frames, view.height, view.width)
    for name, array, wanted, dtype in (("rgb", rgb, (*shape, 3), np.uint8), ("depth", depth, shape, np.uint16)):
        if array.shape != wanted or array.dtype != dtype:
            needed = f"{np.dtype(dtype)} {wanted}"
            raise DataError(f"{folder}/{name}.npy: is {array.dtype} {array.shape}, must be {needed} for its labels")
    return rgb, depth


def scene_folders(root: Path) -> list[Path]:
    """The scenes of a data set, in order; raises `DataError`."""
    if not (root / "dataset.json").is_file():
        raise DataError(
            f"{root} holds no dataset.json; make a data set with `goshawk-sim dataset --out {root}`, "
            f"or bring one in with `goshawk dataset import SRC --out {root}`"
        )
    folders = sorted(p for p in root.iterdir() if p.is_dir() and p.name.startswith("scene_"))
    if not folders:
        raise DataError(f"{root} holds no scene_* folder")
    return folders


def read_view(root: Path) -> View:
    """The camera that `dataset.json` states; raises `DataError`."""
    path = root / "dataset.json"
    about = read_json(path)
    width, height, hfov = (_field(path, about, name) for name in ("width", "height", "hfov_rad"))
    if not (isinstance(width, int) and isinstance(height, int) and 0 < width <= 8192 and 0 < height <= 8192):
        raise DataError(f"{path}: width and height must be numbers of pixels, not {width!r} and {height!r}")
    if not (isinstance(hfov, float | int) and 0.1 < hfov < 3.0):
        raise DataError(f"{path}: hfov_rad must be between 0.1 and 3.0, not {hfov!r}")
    view = View(width=width, height=height, hfov_rad=float(hfov))
    stated = _field(path, about, "vfov_rad")
    if not (isinstance(stated, float) and abs(stated - view.vfov_rad) < 1e-3):
        raise DataError(f"{path}: vfov_rad must be {view.vfov_rad:.6f} for square pixels, not {stated!r}")
    return view


def describe(root: Path) -> str:
    """What a data set is, with the scenes that are there, in a line for the policy's contract; raises `DataError`."""
    path, scenes = root / "dataset.json", len(scene_folders(root))
    about = read_json(path)
    try:
        if "source" in about:
            return f"{root.name}: {scenes} scenes imported from {about['source']['name']}"
        return f"{root.name}: seed {about['seed']}, {scenes} x {about['frames']} frames, {about['commit'][:12]}"
    except (KeyError, TypeError) as error:
        raise DataError(f"{path}: must say seed, frames and commit, or the name of its source") from error


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A scene in memory, to be written."""

    rgb_FHW3: NDArray[np.uint8]
    depth_FHW: NDArray[np.uint16]
    labels: Labels
    points_P3: NDArray[np.float32]
    ground: Ground
    bounds: Bounds
    about: dict[str, Any]
    """What else `scene.json` says."""


def write_scene(folder: Path, scene: Scene) -> None:
    """Write a scene's folder, all or nothing: beside its place, and renamed when complete."""
    partial = folder.with_name(f".{folder.name}.partial")
    if partial.exists():
        shutil.rmtree(partial)
    partial.mkdir(parents=True)
    np.save(partial / "rgb.npy", scene.rgb_FHW3)
    np.save(partial / "depth.npy", scene.depth_FHW)
    np.save(partial / "ground.npy", scene.ground.height_YX)
    write_ply(partial / "environment.ply", scene.points_P3)
    (partial / "labels.csv").write_text(_label_text(scene.labels))
    meta = scene.about | {
        "min_xyz": scene.bounds.min_xyz.tolist(),
        "max_xyz": scene.bounds.max_xyz.tolist(),
        "ground_cell_m": scene.ground.cell_m,
        "ground_min_xy": scene.ground.min_xy.tolist(),
        "ground_shape": list(scene.ground.height_YX.shape),
    }
    (partial / "scene.json").write_text(json.dumps(meta, indent=2) + "\n")
    partial.rename(folder)


@contextmanager
def alone(folder: Path) -> Generator[None]:
    """Makes a folder, and keeps other processes from filling it meanwhile; raises `DataError` if one does."""
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise DataError(
                f"{folder}: another command fills it now; wait for its end, or give another --out"
            ) from error
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(handle)


def _label_text(labels: Labels) -> str:
    lines = [",".join(LABEL_COLUMNS)]
    for i in range(len(labels)):
        cells = [str(i), *(f"{v:.6f}" for v in labels.pos_world_F3[i])]
        cells += [f"{v:.9f}" for v in labels.quaternion_F4[i]]
        cells += [f"{v:.6f}" for v in labels.target_world_F3[i]] if labels.has_target_F[i] else ["", "", ""]
        visible = "" if math.isnan(labels.visible_F[i]) else f"{labels.visible_F[i]:.4f}"
        lines.append(",".join([*cells, visible, f"{labels.ground_F[i]:.6f}"]))
    return "\n".join(lines) + "\n"
