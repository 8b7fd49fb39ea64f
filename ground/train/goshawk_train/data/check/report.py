"""Is a data set fit to train on? Everything that would spoil hours of training, found in a minute."""

from __future__ import annotations

import dataclasses
import math
import os
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from goshawk_dashboards.log.progress import Progress, unheard

from goshawk_train.data import DataError
from goshawk_train.data.check.balance import Balance
from goshawk_train.data.check.conventions import ALTERNATIVES, Agreement, Convention
from goshawk_train.data.check.findings import Finding
from goshawk_train.data.check.scene import SceneReport, check_scene, identity, misfit
from goshawk_train.data.layout import View, read_json, read_view, scene_folders

FRAMES = 8
"""Frames of a scene compared with its map unless told otherwise."""
_EXPLAINED_SCENES = 4
"""So many misfits are searched for any explanation; the others for those found in them, which is much faster."""
_COPIES_TOLERATED = 0.02


@dataclass(frozen=True, kw_only=True)
class Report:
    """What a check found."""

    root: Path
    view: View
    scenes: list[SceneReport]
    findings: list[Finding]
    balance: Balance | None

    @property
    def errors(self) -> list[Finding]:
        """What must be mended before training."""
        return [f for f in self.findings if f.severity == "error"]

    @property
    def frames(self) -> int:
        """Frames of all readable scenes."""
        return sum(scene.frames for scene in self.scenes)

    def figures(self) -> dict[str, float]:
        """The main figures, for the table."""
        known = [s.agreement for s in self.scenes if s.agreement is not None and math.isfinite(s.agreement.median_m)]
        out: dict[str, float] = {"scenes": len(self.scenes), "frames": self.frames}
        out |= self.balance.figures() if self.balance else {}
        if known:
            out["map_median_m"] = float(np.median([a.median_m for a in known]))
            out["map_beyond"] = float(np.mean([a.beyond for a in known]))
        return out | {"errors": len(self.errors), "warnings": len(self.findings) - len(self.errors)}

    def json(self) -> dict[str, Any]:
        """All of it, for programs."""
        scenes = [{"scene": s.folder.name, "frames": s.frames, "map": _plain(s.agreement)} for s in self.scenes]
        balance = self.balance
        histograms: dict[str, Any] = {}
        if balance:
            histograms = {**balance.histograms(), "image": balance.image_counts().tolist()}
        return {
            "data": str(self.root),
            "figures": self.figures(),
            "findings": [dataclasses.asdict(f) for f in self.findings],
            "histograms": histograms,
            "scenes": scenes,
        }


def _plain(found: Agreement | None) -> dict[str, float | None] | None:
    """For JSON, which knows no infinity."""
    if found is None:
        return None
    return {name: value if math.isfinite(value) else None for name, value in dataclasses.asdict(found).items()}


def check(
    root: Path,
    *,
    against: Path | None = None,
    frames: int = FRAMES,
    task: str = "track",
    progress: Progress = unheard,
) -> Report:
    """Check a data set; raises `DataError` if `root` (or `against`) is none."""
    folders, view = scene_folders(root), read_view(root)
    known = _identities(against, progress) if against else {}
    scenes: list[SceneReport] = []

    def checked(folder: Path) -> SceneReport:
        return check_scene(folder, view, frames=frames)

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for report in pool.map(checked, folders):
            scenes.append(report)
            progress("scenes", len(scenes), len(folders))
    findings = [finding for scene in scenes for finding in scene.findings]
    findings += _misfits(scenes, view, progress)
    findings += _copies(scenes) + _leaks(scenes, known, against) + _missing_scenes(root, len(folders))
    parts = [scene.balance for scene in scenes if scene.balance is not None]
    balance = Balance.joined(parts) if parts else None
    if balance:
        findings += balance.findings(root.name, task)
    return Report(root=root, view=view, scenes=scenes, findings=findings, balance=balance)


def _missing_scenes(root: Path, found: int) -> list[Finding]:
    stated = read_json(root / "dataset.json").get("scenes")
    if stated == found:
        return []
    what = f"{found} scenes, dataset.json says {stated}"
    advice = "let the command that makes the data set finish: it goes on where it stopped"
    return [Finding(severity="warning", kind="scenes-missing", where=root.name, what=what, advice=advice)]


def _misfits(scenes: list[SceneReport], view: View, progress: Progress) -> list[Finding]:
    misfits = [scene for scene in scenes if not scene.fits]
    findings, seen = list[Finding](), list[Convention]()
    for done, scene in enumerate(misfits):
        candidates = ALTERNATIVES if done < _EXPLAINED_SCENES else tuple(seen)
        finding, convention = misfit(scene, view, candidates)
        findings.append(finding)
        if convention is not None and convention not in seen:
            seen.append(convention)
        progress("misfits", done + 1, len(misfits))
    return findings


def _copies(scenes: list[SceneReport]) -> list[Finding]:
    """Images that occur more than once, in the scene of the later one."""
    first: dict[str, tuple[str, int]] = {}
    findings: list[Finding] = []
    for scene in scenes:
        copies: dict[str, list[int]] = defaultdict(list)
        for frame, digest in enumerate(scene.digests):
            if digest and digest in first:
                copies[first[digest][0]].append(frame)
            elif digest:
                first[digest] = (scene.folder.name, frame)
        for original, frames in copies.items():
            many = len(frames) > max(_COPIES_TOLERATED * scene.frames, 1)
            of = "this scene" if original == scene.folder.name else original
            finding = Finding(
                severity="error" if many else "warning",
                kind="copies",
                where=scene.folder.name,
                frames=tuple(frames),
                what=f"the same image as others of {of}",
                advice="keep one of each",
            )
            findings.append(finding)
    return findings


def _identities(root: Path, progress: Progress) -> dict[str, str]:
    """Which scene of another data set has which digest."""
    known, folders = dict[str, str](), scene_folders(root)
    for done, folder in enumerate(folders):
        try:
            known |= dict.fromkeys(identity(folder), folder.name)
        except DataError as error:
            raise DataError(f"{error}; check {root} first") from error
        progress(f"scenes of {root.name}", done + 1, len(folders))
    return known


def _leaks(scenes: list[SceneReport], known: dict[str, str], against: Path | None) -> list[Finding]:
    findings: list[Finding] = []
    for scene in scenes:
        shared = sorted(digest for digest in scene.identity if digest in known)
        if shared and against:
            what = " and ".join(digest.split()[0] for digest in shared)
            finding = Finding(
                severity="error",
                kind="leak",
                where=scene.folder.name,
                what=f"the same {what} as {known[shared[0]]} of {against}",
                advice="validate on other scenes: leave it out of one of the two",
            )
            findings.append(finding)
    return findings
