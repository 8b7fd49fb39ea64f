"""The check of one scene."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

from goshawk_train.data import DataError
from goshawk_train.data.check.balance import Balance
from goshawk_train.data.check.conventions import (
    AGREED,
    ALTERNATIVES,
    Agreement,
    Convention,
    agreement,
    explain,
    sample_pixels,
    spread,
)
from goshawk_train.data.check.findings import Finding
from goshawk_train.data.check.images import check_images
from goshawk_train.data.check.poses import check_blank, check_poses, check_targets
from goshawk_train.data.layout import SCENE_FILES, Labels, View, read_ground, read_images, read_labels, read_obstacles
from goshawk_train.data.raymap import RayMap, voxel_centres

PIXELS_A_FRAME = 256


@dataclass(frozen=True, kw_only=True)
class SceneReport:
    """What was found in a scene."""

    folder: Path
    frames: int = 0
    findings: list[Finding]
    balance: Balance | None = None
    agreement: Agreement | None = None
    compared: tuple[int, ...] = ()
    """The frames that were compared with the map."""
    fits: bool = True
    """Whether its images and its map agree (also True where that could not be judged)."""
    digests: tuple[str, ...] = ()
    identity: frozenset[str] = frozenset()
    """Digests of its map and of its poses."""


def _trustworthy(count: int, findings: list[Finding]) -> list[int]:
    """Frames that nothing is wrong with; all, if most are bad: then that is what is to be explained."""
    bad = {frame for finding in findings for frame in finding.frames}
    good = [frame for frame in range(count) if frame not in bad]
    return good if len(good) > count / 2 else list(range(count))


def check_scene(folder: Path, view: View, *, frames: int) -> SceneReport:
    """Everything but the search for a better convention; `frames` are compared with the map."""
    missing = [name for name in SCENE_FILES if not (folder / name).is_file()]
    again = "delete this folder and make or import the scene again"
    if missing:
        what = f"{', '.join(missing)} missing"
        return SceneReport(folder=folder, findings=[_broken(folder, "file-missing", what, again)])
    try:
        labels = read_labels(folder / "labels.csv", 0)
        rgb, depth = read_images(folder, len(labels), view)
        raymap = _raymap(folder)
    except DataError as error:
        what = str(error).removeprefix(f"{folder}/")
        return SceneReport(folder=folder, findings=[_broken(folder, "file-broken", what, again)])
    name = folder.name
    images = check_images(name, rgb, depth)
    findings = images.findings + check_poses(name, labels, raymap)
    findings += check_blank(name, images.blank_F, labels, raymap, view)
    compared = spread(_trustworthy(len(labels), findings), frames)
    found = agreement(raymap, sample_pixels(depth, labels, view, compared, count=PIXELS_A_FRAME))
    fits = found is not None and found.score >= AGREED
    if fits:
        findings += check_targets(name, labels, depth, raymap, view)
    return SceneReport(
        folder=folder,
        frames=len(labels),
        findings=findings,
        balance=Balance.of(labels, view),
        agreement=found,
        compared=tuple(compared),
        fits=fits,
        digests=tuple(images.digests),
        identity=identity(folder, labels),
    )


def _raymap(folder: Path) -> RayMap:
    ground, bounds = read_ground(folder)
    return RayMap.build(read_obstacles(folder), bounds, ground)


def _broken(folder: Path, kind: str, what: str, advice: str) -> Finding:
    return Finding(severity="error", kind=kind, where=folder.name, what=what, advice=advice)


def identity(folder: Path, labels: Labels | None = None) -> frozenset[str]:
    """Digests by which a scene is known again in another data set: of its map and of its poses."""
    labels = labels or read_labels(folder / "labels.csv", 0)
    voxels = voxel_centres(read_obstacles(folder))
    surroundings = voxels.tobytes() if len(voxels) else read_ground(folder)[0].height_YX.tobytes()
    poses = labels.pos_world_F3.round(3).tobytes()
    named = (("map", surroundings), ("poses", poses))
    return frozenset(f"{name} {hashlib.blake2b(data, digest_size=12).hexdigest()}" for name, data in named)


def misfit(
    report: SceneReport, view: View, candidates: tuple[Convention, ...] = ALTERNATIVES
) -> tuple[Finding, Convention | None]:
    """Why a scene's images and map disagree, with the convention that would explain it, if any."""
    labels = read_labels(report.folder / "labels.csv", 0)
    depth = read_images(report.folder, len(labels), view)[1]
    pixels = sample_pixels(depth, labels, view, report.compared, count=PIXELS_A_FRAME)
    raymap = _raymap(report.folder)
    found = report.agreement
    better = explain(raymap, pixels, found, candidates)
    if found is None:
        what = "too little depth between 0.4 and 10 m to compare with the map"
    else:
        median = f"median {found.median_m:.2f} m" if math.isfinite(found.median_m) else "the map is empty there"
        what = f"images and map disagree: {median}, {100 * found.beyond:.0f} % beyond tolerance"
    if better is None:
        advice = "rgb, depth, labels and environment.ply must be of one world: check axes, units and their pairing"
        severity = "warning" if found is None else "error"
        name = report.folder.name
        return Finding(severity=severity, kind="map-disagrees", where=name, what=what, advice=advice), None
    convention, reached = better
    what += f"; {100 * (1 - reached.beyond):.0f} % agree if {convention.what}"
    finding = _broken(report.folder, "map-disagrees", what, convention.advice)
    return finding, convention
