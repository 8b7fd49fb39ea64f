"""Scenes in the layout of the public YOPO-Tracker: what is accepted, read and turned into our frames.

A scene folder holds `rgb/N.jpg` (or .png), `depth/N.png` (16 bits, planar depth), `labels.csv` (or label.csv: one line
a frame, in the order of the numbers N) and `environment.ply`. Nothing is guessed: what cannot be read off the files
is an option, and the outcome is compared with the map.
"""

from __future__ import annotations

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from goshawk_train.data import DataError
from goshawk_train.data.foreign.resample import Intrinsics
from goshawk_train.data.layout import Labels
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

COLUMNS = ("x", "y", "z", "qw", "qx", "qy", "qz", "target_x", "target_y", "target_z")
"""Order of the public data, whose loader goes by position. NaN or empty: no target."""
VISIBLE, SKIPPED = "visible", "-"
_SAME = {
    "px": "x", "py": "y", "pz": "z", "pos_x": "x", "pos_y": "y", "pos_z": "z", "w": "qw", "quat_w": "qw",
    "quat_x": "qx", "quat_y": "qy", "quat_z": "qz", "tx": "target_x", "ty": "target_y", "tz": "target_z",
}  # fmt: skip
_NORM_TOLERANCE = 0.01

Camera = Literal["flu", "frd", "rdf"]
World = Literal["nwu", "ned"]

CAMERAS: dict[Camera, F64] = {
    "flu": np.eye(3),
    "frd": np.diag([1.0, -1, -1]),
    "rdf": np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
}
"""Their axes from forward, left, up: frd forward, right, down; rdf (optical) right, down, forward."""
WORLDS: dict[World, F64] = {"nwu": np.eye(3), "ned": np.diag([1.0, -1, -1])}
"""Ours from theirs. nwu stands for every right-handed frame with z up, ENU too: its heading does not matter."""


@dataclass(frozen=True, kw_only=True)
class Format:
    """What the files do not say of themselves; the defaults are those of the public data."""

    columns: tuple[str, ...] = COLUMNS
    world: World = "nwu"
    camera: Camera = "flu"
    """The axes that the attitudes speak of."""
    tilt_deg: float = 0.0
    """Pitch of the camera against those axes, up positive: for attitudes of a vehicle."""
    depth_unit_mm: float = 1.0
    hfov_deg: float = 90.0
    focal: Intrinsics | None = None
    """Instead of `hfov_deg`: pixels of the source's images."""

    def intrinsics(self, width: int, height: int) -> Intrinsics:
        """The source's camera."""
        return self.focal or Intrinsics.of(width, height, math.radians(self.hfov_deg))


def find_scenes(source: Path) -> list[Path]:
    """The scene folders in `source`, by their number (`source` itself may be one); raises `DataError`."""
    if not source.is_dir():
        raise DataError(f"{source}: no such folder")
    folders = [source] if (source / "rgb").is_dir() else [p for p in source.iterdir() if (p / "rgb").is_dir()]
    if not folders:
        raise DataError(f"{source} holds no scene: expected folders with rgb/, depth/, labels.csv and environment.ply")
    return sorted(folders, key=lambda p: (_number(p), p.name))


def _number(path: Path) -> int:
    digits = re.findall(r"\d+", path.stem)
    return int(digits[-1]) if digits else -1


def image_files(folder: Path) -> list[tuple[Path, Path]]:
    """Colour and depth of each frame, in the order of their numbers; raises `DataError`."""
    rgb, depth = (_numbered(folder / name, kinds) for name, kinds in (("rgb", (".jpg", ".png")), ("depth", (".png",))))
    unpaired = sorted(set(rgb) ^ set(depth))
    if unpaired:
        side = "depth" if unpaired[0] in rgb else "rgb"
        raise DataError(f"{folder}/{side}: no image number {unpaired[0]}, which the other folder has; delete or add it")
    return [(rgb[number], depth[number]) for number in sorted(rgb)]


def _numbered(folder: Path, kinds: tuple[str, ...]) -> dict[int, Path]:
    if not folder.is_dir():
        raise DataError(f"{folder}: missing")
    files = [p for p in folder.iterdir() if p.suffix.lower() in kinds]
    if not files:
        raise DataError(f"{folder}: no {' or '.join(kinds)} files")
    out: dict[int, Path] = {}
    for path in files:
        number = _number(path)
        if number < 0 or number in out:
            raise DataError(f"{path}: images are paired by the number in their names, which is missing or not unique")
        out[number] = path
    return out


def read_rgb(path: Path) -> NDArray[np.uint8]:
    """[H, W, 3]; raises `DataError`."""
    try:
        with Image.open(path) as image:
            return np.asarray(image.convert("RGB"))
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise DataError(f"{path}: not a readable image: {error}") from error


def read_depth_mm(path: Path, unit_mm: float) -> NDArray[np.uint16]:
    """[H, W], 0: none; beyond 65 m: none. Raises `DataError`."""
    try:
        with Image.open(path) as image:
            mode, raw = image.mode, np.asarray(image)
    except (OSError, UnidentifiedImageError, SyntaxError) as error:
        raise DataError(f"{path}: not a readable image: {error}") from error
    if raw.ndim != 2 or mode not in ("I;16", "I;16B", "I"):
        raise DataError(f"{path}: depth must be a PNG of one channel of 16 bits, not of mode {mode}")
    depth = raw.astype(np.float64) * unit_mm
    return np.where(depth < 65535, np.rint(depth), 0).astype(np.uint16)


def read_labels(folder: Path, frames: int, form: Format) -> Labels:
    """Poses and targets of a scene in our frames; ground heights are still 0. Raises `DataError`."""
    path = next((p for name in ("labels.csv", "label.csv") if (p := folder / name).is_file()), None)
    if path is None:
        raise DataError(f"{folder}/labels.csv: missing")
    table = _table(path, form.columns)
    if len(table) != frames:
        raise DataError(f"{path}: {len(table)} rows for {frames} images; each image needs its row")
    column = {name: values for name, values in zip(form.columns, table.T, strict=True) if name != SKIPPED}
    pos = np.stack([column[c] for c in "xyz"], axis=-1)
    quaternion = np.stack([column[f"q{c}"] for c in "wxyz"], axis=-1)
    target = np.stack([column[f"target_{c}"] for c in "xyz"], axis=-1)
    bad = ~np.isfinite(np.hstack([pos, quaternion])).all(axis=1)
    bad |= ~(np.abs(np.linalg.norm(quaternion, axis=1) - 1) <= _NORM_TOLERANCE)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        raise DataError(f"{path}: row {row}: not a finite position and unit quaternion; correct it or --columns")
    has_target: NDArray[np.bool_] = np.asarray(np.isfinite(target).all(axis=1))
    world, camera = WORLDS[form.world], CAMERAS[form.camera]
    tilt = geometry.rotation_y(-math.radians(form.tilt_deg))
    world_from_cam = world @ geometry.matrix_from_quaternion(quaternion) @ camera @ tilt
    visible = column.get(VISIBLE, np.ones(frames))
    return Labels(
        pos_world_F3=pos @ world.T,
        quaternion_F4=geometry.quaternion_from_matrix(world_from_cam),
        world_from_cam_F33=world_from_cam,
        target_world_F3=np.where(has_target[:, None], target, 0.0) @ world.T,
        has_target_F=has_target,
        visible_F=np.where(has_target, np.nan_to_num(visible), 0.0),
        ground_F=np.zeros(frames),
        scene_F=np.zeros(frames, dtype=np.int64),
    )


def _table(path: Path, columns: tuple[str, ...]) -> F64:
    """The numbers of a CSV file, [rows, columns]; its head must not contradict `columns`."""
    try:
        with path.open(newline="") as file:
            rows = [[cell.strip() for cell in row] for row in csv.reader(file) if row]
    except (csv.Error, UnicodeDecodeError) as error:
        raise DataError(f"{path}: not a table: {error}") from error
    if not rows:
        raise DataError(f"{path}: empty")
    head = [_SAME.get(cell.lower(), cell.lower()) for cell in rows[0]]
    if any(re.match(r"[a-z_]", name) and name not in ("nan", "inf") for name in head):
        rows = rows[1:]
        for number, (name, wanted) in enumerate(zip(head, columns, strict=False)):
            if name != wanted and name in (*COLUMNS, VISIBLE):
                raise DataError(f"{path}: column {number + 1} is {name}, not {wanted}: give the order with --columns")
    out = np.full((len(rows), len(columns)), np.nan)
    for number, row in enumerate(rows):
        if len(row) < len(columns):
            raise DataError(f"{path}: row {number} has {len(row)} of {len(columns)} columns; see --columns")
        try:
            out[number] = [
                float(cell) if cell and name != SKIPPED else math.nan for name, cell in zip(columns, row, strict=False)
            ]
        except ValueError as error:
            raise DataError(f"{path}: row {number}: {error}") from error
    return out
