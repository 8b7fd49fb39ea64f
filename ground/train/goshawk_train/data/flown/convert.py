"""Flight logs to a data set in our layout: a scene for each stretch of flight.

Shape letters: F images of a stretch, K of them that are kept, A and S points ahead of a camera.
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from goshawk_dashboards.log.progress import Progress, unheard
from numpy.typing import NDArray

from goshawk_train.data import DataError
from goshawk_train.data.flown import mine
from goshawk_train.data.flown.fuse import Fused, Fusion
from goshawk_train.data.flown.mine import Mask, Other, Reason
from goshawk_train.data.flown.recording import Recording, read
from goshawk_train.data.flown.track import Track, follow
from goshawk_train.data.foreign.resample import OURS
from goshawk_train.data.layout import Labels, Scene, alone, write_scene
from goshawk_train.data.raymap import VOXEL_M
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

_FUSED_EVERY_S = 0.1
_FEWEST = 8
"""A stretch with fewer images is no scene."""
_AHEAD_M = np.arange(1.0, 9.0)
_AHEAD_PX = 8
_AHEAD_HEIGHT_M = (0.3, 2.5)
"""A camera's view ahead, between these heights over the ground, is where its trajectories go."""
KNOWN_LEAST = 0.5
"""Images of whose view ahead less was seen in the flight are left out: the map would be made up."""


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Which images are kept."""

    rate_hz: float = 5.0
    """So many a second, whatever they show; 0: none but the mined."""
    mine: tuple[Reason, ...] = ()
    """Images that are kept all, by reason."""
    other: Path | None = None
    """The policy of "disagree"."""


@dataclass(kw_only=True)
class Outcome:
    """What was made of the logs."""

    scenes: int = 0
    kept: int = 0
    found: Counter[str] = field(default_factory=Counter[str])
    """How many images there were, by what they are or why they were kept."""
    of_kept: Counter[str] = field(default_factory=Counter[str])
    """The same of those that were kept."""
    notes: list[str] = field(default_factory=list[str])
    """What a person should know, one line each."""

    def table(self) -> str:
        """How many images there were and how many are kept, in all and by reason; one may have several reasons."""
        rows = [("images", "found", "kept"), ("in the logs", str(self.found["in the logs"]), str(self.kept))]
        rows += [(name, str(n), str(self.of_kept[name])) for name, n in self.found.items() if name != "in the logs"]
        rows.append(("scenes", "", str(self.scenes)))
        width = max(len(name) for name, _, _ in rows)
        return "\n".join(f"  {name:<{width}}  {found:>8}  {kept:>8}" for name, found, kept in rows)


def from_logs(logs: Sequence[Path], out: Path, choice: Choice, progress: Progress = unheard) -> Outcome:
    """Make a data set of logs, all or nothing; raises `DataError`."""
    paths = _paths(logs)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise DataError(f"{out} is there already: choose another --out, and give both to the training")
    other = Other(choice.other) if choice.other else None
    with alone(partial := out.with_name(f".{out.name}.partial")):
        for left in partial.iterdir():  # of one that was killed
            shutil.rmtree(left) if left.is_dir() else left.unlink()
        try:
            outcome, vehicles = Outcome(), Counter[str]()
            for done, path in enumerate(paths):
                recording = read(path)
                _count(recording, outcome)
                for stretch in range(int(recording.stretch_F[-1]) + 1):
                    _stretch(recording, stretch, choice, other, partial, outcome)
                vehicles[recording.flight.header.vehicle or "an unnamed vehicle"] += 1
                progress("logs", done + 1, len(paths))
            if not outcome.scenes:
                raise DataError(f"{paths[0]}{' and the others' if len(paths) > 1 else ''}: no image is fit to be kept")
            _write_about(partial, choice, outcome, vehicles)
            if out.exists():
                out.rmdir()
            partial.rename(out)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    return outcome


def _paths(logs: Sequence[Path]) -> list[Path]:
    """The logs, those of folders by name; each once."""
    paths: list[Path] = []
    for log in logs:
        inside = sorted(log.glob("*.mcap")) if log.is_dir() else [log]
        if not inside:
            raise DataError(f"{log} holds no log (*.mcap)")
        known = {path.resolve() for path in paths}
        paths += [path for path in inside if path.resolve() not in known]
    return paths


def _count(recording: Recording, outcome: Outcome) -> None:
    outcome.found["in the logs"] += recording.flight.count("rgbd")
    outcome.found["in flight"] += len(recording.stamp_F)
    if recording.flight.missing:
        outcome.notes.append(f"{recording.name}: damaged, {', '.join(recording.flight.missing)} missing")


def _stretch(
    recording: Recording, stretch: int, choice: Choice, other: Other | None, folder: Path, outcome: Outcome
) -> None:
    """Write a stretch's scene, if it is one."""
    frames_F = np.flatnonzero(recording.stretch_F == stretch)
    if len(frames_F) < _FEWEST:
        outcome.notes.append(f"{recording.name}: {len(frames_F)} images between two jumps are left out")
        return
    depth_FHW = np.stack([recording.depth(int(frame)) for frame in frames_F])
    track = follow(recording, frames_F, depth_FHW)
    try:
        fused = _fuse(recording, frames_F, depth_FHW, track)
    except DataError as error:
        raise DataError(f"{recording.flight.path}: {error}") from error
    reasons = _reasons(recording, frames_F, fused, choice, other)
    known_F = _known_ahead(recording, frames_F, fused) >= KNOWN_LEAST
    plain_F = _spaced(recording.time_F[frames_F], choice.rate_hz)
    kept_F = known_F & np.logical_or.reduce([plain_F, *reasons.values()])
    if few := kept_F.sum() < _FEWEST:
        outcome.notes.append(
            f"{recording.name}: a stretch of {len(frames_F)} images has {kept_F.sum()} to keep: left out"
        )
        kept_F[:] = False
    outcome.of_kept["in flight"] += int(kept_F.sum())
    masks = {"view ahead never seen": ~known_F, "by rate": plain_F, **reasons, "target unknown": ~track.known_F}
    for name, mask in masks.items():
        outcome.found[name] += int(mask.sum())
        outcome.of_kept[name] += int((mask & kept_F).sum())
    if few:
        return
    scene = _scene(recording, frames_F, kept_F, depth_FHW, track, fused, reasons)
    write_scene(folder / f"scene_{outcome.scenes:04d}", scene)
    outcome.scenes += 1
    outcome.kept += int(kept_F.sum())


def _fuse(recording: Recording, frames_F: NDArray[np.int64], depth_FHW: NDArray[np.uint16], track: Track) -> Fused:
    pos_F3 = recording.pos_world_F3[frames_F]
    fusion = Fusion(OURS, pos_F3)
    for f in np.flatnonzero(_spaced(recording.time_F[frames_F], 1 / _FUSED_EVERY_S)):
        target = track.pos_world_F3[f] if track.near_F[f] else None
        fusion.add(depth_FHW[f], pos_F3[f], recording.world_from_cam_F33[frames_F[f]], target)
    return fusion.result()


def _reasons(
    recording: Recording,
    frames_F: NDArray[np.int64],
    fused: Fused,
    choice: Choice,
    other: Other | None,
) -> dict[str, Mask]:
    found: dict[str, Mask] = {}
    for reason in choice.mine:
        if reason == "near-miss":
            found[reason] = mine.near_miss(recording, frames_F, fused)
        elif reason == "lost":
            found[reason] = mine.lost(recording, frames_F)
        elif reason == "doubt":
            found[reason] = mine.doubt(recording, frames_F)
        elif other is not None:
            found[reason] = other.differs(recording, frames_F)
    return found


def _spaced(time_F: F64, rate_hz: float) -> Mask:
    """Images at least so far apart, the first is one of them; none at a rate of 0."""
    slot = np.floor((time_F - time_F[0]) * rate_hz + 1e-6)
    return (np.diff(slot, prepend=-1.0) > 0) & (rate_hz > 0)


def _known_ahead(recording: Recording, frames_F: NDArray[np.int64], fused: Fused) -> F64:
    """Which share of the view ahead, above the ground, the flight saw at some time."""
    rays_A3 = geometry.pixel_rays(OURS)[_AHEAD_PX // 2 :: _AHEAD_PX, _AHEAD_PX // 2 :: _AHEAD_PX].reshape(-1, 3)
    share = np.zeros(len(frames_F))
    for f, frame in enumerate(frames_F):
        ray = rays_A3 @ recording.world_from_cam_F33[frame].T
        pos_AS3 = recording.pos_world_F3[frame] + _AHEAD_M[:, None] * ray[:, None]
        height = pos_AS3[..., 2] - fused.ground.at(pos_AS3)
        asked = (height > _AHEAD_HEIGHT_M[0]) & (height < _AHEAD_HEIGHT_M[1])
        share[f] = fused.known(pos_AS3[asked]).mean() if asked.any() else 0.0
    return share


def _scene(
    recording: Recording,
    frames_F: NDArray[np.int64],
    kept_F: Mask,
    depth_FHW: NDArray[np.uint16],
    track: Track,
    fused: Fused,
    reasons: dict[str, Mask],
) -> Scene:
    frames_K = frames_F[kept_F]
    known_K = track.known_F[kept_F]
    pos_K3, world_from_cam = recording.pos_world_F3[frames_K], recording.world_from_cam_F33[frames_K]
    labels = Labels(
        pos_world_F3=pos_K3,
        quaternion_F4=geometry.quaternion_from_matrix(world_from_cam),
        world_from_cam_F33=world_from_cam,
        target_world_F3=np.where(known_K[:, None], track.pos_world_F3[kept_F], 0.0),
        has_target_F=known_K,
        visible_F=track.visible_F[kept_F],
        ground_F=fused.ground.at(pos_K3),
        scene_F=np.zeros(len(frames_K), dtype=np.int64),
    )
    return Scene(
        rgb_FHW3=np.stack([recording.rgb(int(frame)) for frame in frames_K]),
        depth_FHW=depth_FHW[kept_F],
        labels=labels,
        points_P3=fused.points_P3,
        ground=fused.ground,
        bounds=fused.bounds,
        about=_origin(recording, frames_F) | {"mined": {name: int((m & kept_F).sum()) for name, m in reasons.items()}},
    )


def _origin(recording: Recording, frames_F: NDArray[np.int64]) -> dict[str, Any]:
    header = recording.flight.header
    return {
        "source": recording.name,
        "voxel_m": VOXEL_M,
        "flight": {
            "vehicle": header.vehicle,
            "vehicle_sha256": hashlib.sha256(header.vehicle_toml.encode()).hexdigest(),
            "policy_sha256": header.policy_sha256,
            "wall_time": header.wall_time,
            "from_s": round(float(recording.time_F[frames_F[0]]), 3),
            "to_s": round(float(recording.time_F[frames_F[-1]]), 3),
            "camera_tilt_deg": round(math.degrees(recording.mount.tilt_rad), 3),
            "camera_position_m": list(recording.mount.position_m),
            "camera_hfov_deg": round(math.degrees(OURS.hfov_rad), 3),
        },
    }


def _write_about(folder: Path, choice: Choice, outcome: Outcome, vehicles: Counter[str]) -> None:
    named = ", ".join(f"{count} flight{'s' if count > 1 else ''} of {name}" for name, count in vehicles.items())
    about = {"version": 1, "width": OURS.width, "height": OURS.height, "hfov_rad": OURS.hfov_rad}
    source = {
        "name": named,
        "layout": "Goshawk flight log",
        "rate_hz": choice.rate_hz,
        "mine": list(choice.mine),
        "other": choice.other.name if choice.other else None,
    }
    about |= {"vfov_rad": OURS.vfov_rad, "scenes": outcome.scenes, "source": source}
    (folder / "dataset.json").write_text(json.dumps(about, indent=2) + "\n")
