"""Foreign scenes to our layout: one that the trainer reads, with images as our camera would have taken them."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from goshawk_dashboards.log.progress import Progress, unheard
from numpy.typing import NDArray

from goshawk_train.data import DataError
from goshawk_train.data.check.conventions import AGREED, agreement, explain, sample_pixels, spread
from goshawk_train.data.check.poses import target_in_camera
from goshawk_train.data.foreign import yopo
from goshawk_train.data.foreign.ground import estimate_ground
from goshawk_train.data.foreign.resample import OURS, Resampler
from goshawk_train.data.foreign.yopo import WORLDS, Format
from goshawk_train.data.layout import Bounds, Ground, Labels, Scene, alone, read_heights, read_json, write_scene
from goshawk_train.data.ply import read_ply
from goshawk_train.data.raymap import VOXEL_M, RayMap, voxel_centres
from goshawk_train.model import geometry

ABOVE_GROUND_M = 0.3
"""Points lower than this over the ground are the ground, not obstacles."""
_MARGIN_M = 1.0
_OUT_OF_VIEW_MOST = 0.5
_GROUND_SEEN_LEAST = 0.3
_FRAMES_JUDGED, _PIXELS_JUDGED = 12, 256


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What an import did."""

    imported: int
    kept: int
    frames: int
    notes: list[str]
    """What a person should know, one line each."""


def import_scenes(source: Path, out: Path, form: Format, progress: Progress = unheard) -> Outcome:
    """Convert what is not there yet; raises `DataError`, finished scenes stay."""
    folders = yopo.find_scenes(source)
    with alone(out):
        return _imported(source, folders, out, form, progress)


def _imported(source: Path, folders: list[Path], out: Path, form: Format, progress: Progress) -> Outcome:
    done = _open(source, out, form)
    left = [folder for folder in folders if folder.name not in done]
    _write_about(source, out, form, scenes=len(done) + len(left))
    images = {folder: len(yopo.image_files(folder)) for folder in left}
    notes, finished = list[str](), 0
    number = max(done.values(), default=-1) + 1
    for folder in left:
        before = finished

        def step(frames: int, before: int = before) -> None:
            progress("images", before + frames, sum(images.values()))

        scene, said = convert(folder, form, step)
        write_scene(out / f"scene_{number:04d}", scene)
        notes += said
        number, finished = number + 1, finished + len(scene.labels)
    return Outcome(imported=len(left), kept=len(folders) - len(left), frames=finished, notes=notes)


def _about(source: Path, form: Format) -> dict[str, Any]:
    return {"name": source.resolve().name, "layout": "YOPO-Tracker", **json.loads(json.dumps(dataclasses.asdict(form)))}


def _open(source: Path, out: Path, form: Format) -> dict[str, int]:
    """The source's scenes that are there already, with their numbers; raises `DataError` if `out` is something else."""
    if not (out / "dataset.json").exists():
        if out.exists() and any(out.iterdir()):
            raise DataError(f"{out} is not empty and holds no dataset.json: choose another folder")
        return {}
    there = read_json(out / "dataset.json").get("source")
    if there != _about(source, form):
        raise DataError(f"{out} already holds a data set of other origin or options ({there}): choose another folder")
    done: dict[str, int] = {}
    for folder in sorted(out.glob("scene_*")):
        number = folder.name.removeprefix("scene_")
        if not number.isdecimal():
            raise DataError(f"{folder} is none of the import's scenes: remove it from the data set")
        done[str(read_json(folder / "scene.json").get("source"))] = int(number)
    return done


def _write_about(source: Path, out: Path, form: Format, *, scenes: int) -> None:
    about = {"version": 1, "width": OURS.width, "height": OURS.height, "hfov_rad": OURS.hfov_rad}
    about |= {"vfov_rad": OURS.vfov_rad, "scenes": scenes, "source": _about(source, form)}
    partial = out / ".dataset.json.partial"
    partial.write_text(json.dumps(about, indent=2) + "\n")
    partial.replace(out / "dataset.json")


def convert(folder: Path, form: Format, step: Callable[[int], None] = lambda _: None) -> tuple[Scene, list[str]]:
    """One scene and what is to be said of it; raises `DataError`."""
    files = yopo.image_files(folder)
    labels = yopo.read_labels(folder, len(files), form)
    points = read_ply(folder / "environment.ply") @ WORLDS[form.world].T.astype(np.float32)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise DataError(f"{folder}/environment.ply: no points")
    reach = np.vstack([points, labels.pos_world_F3])
    bounds = Bounds(min_xyz=reach.min(axis=0) - _MARGIN_M, max_xyz=reach.max(axis=0) + _MARGIN_M)
    ground = _ground(folder, points, bounds)
    obstacles = voxel_centres(points[points[:, 2] > ground.at(points) + ABOVE_GROUND_M])
    labels = dataclasses.replace(labels, ground_F=ground.at(labels.pos_world_F3))
    labels = _without_unseen(folder, labels)
    rgb, depth, notes = _images(folder, files, form, step)
    scene = Scene(
        rgb_FHW3=rgb,
        depth_FHW=depth,
        labels=labels,
        points_P3=obstacles,
        ground=ground,
        bounds=bounds,
        about={"source": folder.name, "voxel_m": VOXEL_M},
    )
    return scene, notes + _judged(folder, scene)


def _ground(folder: Path, points: NDArray[np.float32], bounds: Bounds) -> Ground:
    """`ground.npy` with `ground.json` if the source has them, else an estimate."""
    if not (folder / "ground.npy").is_file():
        found, seen = estimate_ground(points, bounds)
        if seen < _GROUND_SEEN_LEAST:
            raise DataError(
                f"{folder}/environment.ply shows the ground in only {100 * seen:.0f} % of its area: scan it too, "
                "or add ground.npy (heights [y, x]) with ground.json (cell_m, min_xy)"
            )
        return found
    about = read_json(folder / "ground.json")
    try:
        cell, min_xy = float(about["cell_m"]), np.array([float(c) for c in about["min_xy"]])
        if not (np.isfinite([cell, *min_xy]).all() and cell > 0 and len(min_xy) == 2):
            raise ValueError("no grid")
    except (KeyError, TypeError, ValueError) as error:
        raise DataError(f'{folder}/ground.json: must be {{"cell_m": .., "min_xy": [x, y]}}, world z up') from error
    given = Ground(height_YX=read_heights(folder / "ground.npy"), min_xy=min_xy, cell_m=cell)
    shape = np.ceil((bounds.max_xyz[:2] - bounds.min_xyz[:2]) / cell).astype(int) + 1
    x, y = (bounds.min_xyz[i] + cell * np.arange(shape[i], dtype=np.float64) for i in (0, 1))
    nodes = np.stack(cast("list[NDArray[np.float64]]", np.meshgrid(x, y)), axis=-1)
    return Ground(height_YX=given.at(nodes).astype(np.float32), min_xy=bounds.min_xyz[:2], cell_m=cell)


def _without_unseen(folder: Path, labels: Labels) -> Labels:
    """Targets that cannot be in our image are marked hidden."""
    pos_cam = target_in_camera(labels)
    ahead = pos_cam[:, 0] > 0.1
    u, v = geometry.project(np.where(ahead[:, None], pos_cam, [1.0, 0, 0]), OURS)
    seen = ahead & (u >= 0) & (u < OURS.width) & (v >= 0) & (v < OURS.height)
    marked = labels.has_target_F & (labels.visible_F > 0)
    if (marked & ~seen).sum() > _OUT_OF_VIEW_MOST * max(marked.sum(), 1):
        raise DataError(
            f"{folder}/labels.csv: {(marked & ~seen).sum()} of {marked.sum()} targets lie outside of the view: "
            "correct --columns, --world, --camera or --tilt-deg"
        )
    return dataclasses.replace(labels, visible_F=np.where(seen, labels.visible_F, 0.0))


def _images(
    folder: Path, files: list[tuple[Path, Path]], form: Format, step: Callable[[int], None]
) -> tuple[NDArray[np.uint8], NDArray[np.uint16], list[str]]:
    """All frames as our camera sees them."""
    first_rgb, first_depth = yopo.read_rgb(files[0][0]), yopo.read_depth_mm(files[0][1], form.depth_unit_mm)
    if form.focal is not None and first_rgb.shape[:2] != first_depth.shape:
        raise DataError(f"{files[0][1]}: --fx needs colour and depth of one size, rectified to one camera")
    try:
        colour, range_ = (
            Resampler(shape[1], shape[0], form.intrinsics(shape[1], shape[0]))
            for shape in (first_rgb.shape, first_depth.shape)
        )
    except DataError as error:
        raise DataError(f"{files[0][0]}: {error}") from error
    rgb = np.empty((len(files), OURS.height, OURS.width, 3), dtype=np.uint8)
    depth = np.empty((len(files), OURS.height, OURS.width), dtype=np.uint16)

    def one(frame: int) -> None:
        rgb_path, depth_path = files[frame]
        source_rgb = yopo.read_rgb(rgb_path)
        source_depth = yopo.read_depth_mm(depth_path, form.depth_unit_mm)
        for path, shape, sampler in (
            (rgb_path, source_rgb.shape[:2], colour),
            (depth_path, source_depth.shape, range_),
        ):
            if shape != sampler.size:
                raise DataError(f"{path}: is {shape[1]} x {shape[0]}, the scene's first {sampler.size[::-1]}")
        rgb[frame], depth[frame] = colour.rgb(source_rgb), range_.depth(source_depth)

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for done, _ in enumerate(pool.map(one, range(len(files)))):
            step(done + 1)
    seen = min(*colour.covered, *range_.covered)
    note = f"{folder.name}: its images cover {100 * seen:.0f} % of our view; the rest repeats their border, no depth"
    return rgb, depth, [note] if seen < 1 else []


def _judged(folder: Path, scene: Scene) -> list[str]:
    """Refuses what a simple convention explains better; notes what merely fits badly."""
    raymap = RayMap.build(scene.points_P3, scene.bounds, scene.ground)
    frames = spread(range(len(scene.labels)), _FRAMES_JUDGED)
    pixels = sample_pixels(scene.depth_FHW, scene.labels, OURS, frames, count=_PIXELS_JUDGED)
    found = agreement(raymap, pixels)
    if found is not None and found.score >= AGREED:
        return []
    better = explain(raymap, pixels, found)
    share = f"{100 * (1 - found.beyond):.0f} % of its depth agrees with its map" if found else "its depth is unusable"
    if better is not None:
        convention, reached = better
        raise DataError(
            f"{folder}: {share}, {100 * (1 - reached.beyond):.0f} % if {convention.what}: correct --columns, --world, "
            "--camera, --tilt-deg, --hfov-deg or --depth-unit-mm"
        )
    return [f"{folder.name}: {share}; look at it with `goshawk dataset check`"]
