"""A data set from its recipe: makes the scenes that are not there, each all or nothing."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import shutil
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from goshawk_dashboards.log.progress import Progress, unheard

from goshawk_train.data import DataError
from goshawk_train.data.layout import alone, read_json
from goshawk_train.data.made.engines import Engine
from goshawk_train.data.made.scene import Files, Makers, Recipe, SceneError

RECIPE = "recipe.json"
"""Beside `dataset.json`: what every scene was made of. `goshawk-sim dataset` writes none."""

DECIDES = {"frames": "number of frames", "seed": "seed", "simulator_sha256": "goshawk-sim"}
"""What decides a scene, in words."""


def recipe_of(simulator: Path, *, scenes: int, frames: int, seed: int) -> Recipe:
    """With the simulator as it is now; raises `DataError`."""
    if not simulator.is_file():
        raise DataError(f"{simulator} is missing: build it with `make build`")
    digest = hashlib.sha256(simulator.read_bytes()).hexdigest()
    return Recipe(scenes=scenes, frames=frames, seed=seed, simulator_sha256=digest)


def make(simulator: Path, recipe: Recipe, out: Path, engine: Callable[[], Engine], progress: Progress = unheard) -> int:
    """The data set in `out`, whole; how many scenes of it are new. Raises `DataError`. Whatever ends it, scenes that
    are finished stay, and the next call makes the others."""
    with alone(out):
        _begin(simulator, recipe, out)
        missing = [scene for scene in range(recipe.scenes) if not _folder(out, scene).is_dir()]
        progress("scenes", recipe.scenes - len(missing), recipe.scenes)
        if missing:
            with closing(engine()) as making:
                for count, (scene, files) in enumerate(making.make(missing), start=1):
                    _keep(_folder(out, scene), files)
                    progress("scenes", recipe.scenes - len(missing) + count, recipe.scenes)
        return len(missing)


def _folder(out: Path, scene: int) -> Path:
    return out / f"scene_{scene:04d}"


def _begin(simulator: Path, recipe: Recipe, out: Path) -> None:
    """Says in `out` what is made; refuses what is there of anything else. Only scenes may become more."""
    wanted = dataclasses.asdict(recipe)
    path = out / RECIPE
    if path.is_file():
        known = read_json(path)
        if changed := [what for name, what in DECIDES.items() if known.get(name) != wanted[name]]:
            raise DataError(f"{out} was begun with another {changed[0]}: give that again, or choose another --out")
        if not known.get("scenes", 0) <= recipe.scenes:
            raise DataError(f"{out} was begun with {known['scenes']} scenes: give as many at least, or another --out")
    elif out.is_dir() and any(out.iterdir()):
        raise DataError(f"{out} holds something else, without {RECIPE}: choose another --out")
    try:
        Makers().run([str(simulator), *recipe.arguments(out, 0, 0)])
    except SceneError as error:
        raise DataError(str(error)) from error
    partial = out / f".{RECIPE}.{os.getpid()}.partial"
    partial.write_text(json.dumps(wanted, indent=1) + "\n")
    partial.replace(path)


def _keep(folder: Path, files: Files) -> None:
    """A scene's folder, all or nothing."""
    partial = folder.with_name(f".{folder.name}.partial")
    if partial.exists():
        shutil.rmtree(partial)
    partial.mkdir()
    for name, content in files.items():
        (partial / name).write_bytes(content)
    partial.rename(folder)
