"""What a data set shows how often. Shape letter: F frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data.check.findings import Finding
from goshawk_train.data.check.poses import target_in_camera
from goshawk_train.data.layout import Labels, View
from goshawk_train.model import geometry

F64 = NDArray[np.float64]

SEEN = 0.5
"""A target of which so much is visible counts as shown."""
IMAGE_COLUMNS, IMAGE_ROWS = 10, 6
_FEWEST_SHOWN, _FEWEST_EMPTY = 0.2, 0.02
_COLUMN_LEAST = 0.25
_JUDGED_TARGETS = 100
_PITCH_STD_LEAST_DEG = 1.0
_FAR_LEAST_M = 6.0


@dataclass(frozen=True, kw_only=True)
class Balance:
    """One value a frame; those of the target are NaN where none is shown."""

    distance_F: F64
    u_F: F64
    """0 .. 1 from the image's left."""
    v_F: F64
    """0 .. 1 from its top."""
    height_F: F64
    """Of the camera above the ground, m."""
    pitch_F: F64
    """Of the camera, up positive, degrees."""
    has_target_F: NDArray[np.bool_]
    shown_F: NDArray[np.bool_]

    @classmethod
    def of(cls, labels: Labels, view: View) -> Balance:
        """Of one scene's frames."""
        pos_cam = target_in_camera(labels)
        shown = labels.has_target_F & (labels.visible_F >= SEEN) & (pos_cam[:, 0] > 0.1)
        u, v = geometry.project(np.where(shown[:, None], pos_cam, [1.0, 0, 0]), view)
        nothing = np.full(len(labels), np.nan)
        return cls(
            distance_F=np.where(shown, np.linalg.norm(pos_cam, axis=1), nothing),
            u_F=np.where(shown, u / view.width, nothing),
            v_F=np.where(shown, v / view.height, nothing),
            height_F=labels.pos_world_F3[:, 2] - labels.ground_F,
            pitch_F=np.degrees(np.arcsin(np.clip(labels.world_from_cam_F33[:, 2, 0], -1, 1))),
            has_target_F=labels.has_target_F,
            shown_F=shown,
        )

    @classmethod
    def joined(cls, parts: Sequence[Balance]) -> Balance:
        """Of several scenes."""
        names = [field.name for field in dataclasses.fields(cls)]
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def image_counts(self) -> NDArray[np.int64]:
        """Number of shown targets in each part of the image, [IMAGE_ROWS, IMAGE_COLUMNS] from the top left."""
        bins, box = (IMAGE_ROWS, IMAGE_COLUMNS), ((0, 1), (0, 1))
        counts, _, _ = np.histogram2d(self.v_F[self.shown_F], self.u_F[self.shown_F], bins=bins, range=box)
        return counts.astype(np.int64)

    def histograms(self) -> dict[str, dict[str, list[float]]]:
        """Counts and the edges of their bins, for programs."""
        ranges = {
            "distance_m": (self.distance_F[self.shown_F], np.arange(0.0, 21.0)),
            "height_m": (self.height_F, np.arange(0.0, 6.1, 0.5)),
            "pitch_deg": (self.pitch_F, np.arange(-60.0, 61.0, 10.0)),
        }
        return {
            name: {"edges": edges.tolist(), "counts": np.histogram(values, edges)[0].tolist()}
            for name, (values, edges) in ranges.items()
        }

    def figures(self) -> dict[str, float]:
        """The main figures."""
        shown = self.distance_F[self.shown_F]
        out = {"with_target": float(self.has_target_F.mean()), "target_shown": float(self.shown_F.mean())}
        if len(shown):
            for name, share in (("p5", 5), ("p50", 50), ("p95", 95)):
                out[f"distance_{name}_m"] = float(np.percentile(shown, share))
        out["height_p50_m"] = float(np.median(self.height_F))
        out["pitch_mean_deg"] = float(self.pitch_F.mean())
        out["pitch_std_deg"] = float(self.pitch_F.std())
        return out

    def findings(self, where: str, task: str) -> list[Finding]:
        """What would make the policy lopsided."""
        found: list[tuple[str, str, str]] = []
        if self.pitch_F.std() < _PITCH_STD_LEAST_DEG:
            found.append(("balance-pitch", "all frames have one pitch", "vary the camera's attitude as flight does"))
        if task == "track":
            found += self._of_targets()
        return [Finding(severity="warning", kind=k, where=where, what=w, advice=a) for k, w, a in found]

    def _of_targets(self) -> list[tuple[str, str, str]]:
        shown = float(self.shown_F.mean())
        if shown < _FEWEST_SHOWN:
            what = f"only {100 * shown:.0f} % of the frames show the target"
            return [("balance-target", what, "add frames with the target, or train to navigate only (--task navigate)")]
        if self.shown_F.sum() < _JUDGED_TARGETS:
            return []
        found: list[tuple[str, str, str]] = []
        if shown > 1 - _FEWEST_EMPTY:
            advice = "add frames without the target: otherwise false alarms are not unlearnt"
            found.append(("balance-empty", f"{100 * shown:.0f} % of the frames show the target", advice))
        across = self.image_counts().reshape(IMAGE_ROWS, 5, -1).sum(axis=(0, 2)) / max(int(self.shown_F.sum()), 1)
        for column in np.flatnonzero(across < _COLUMN_LEAST / 5):
            what = f"{100 * across[column]:.1f} % of the targets are in fifth {column + 1} of the image from the left"
            found.append(("balance-image", what, "add frames with the target there"))
        far = float(np.percentile(self.distance_F[self.shown_F], 95))
        if far < _FAR_LEAST_M:
            what = f"95 % of the targets are nearer than {far:.1f} m"
            found.append(("balance-distance", what, "add frames with far targets, or a lost one is not seen again"))
        return found
