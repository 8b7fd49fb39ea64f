"""Which images of a flight teach most: where it nearly hit, lost the target, was in doubt, or another policy differs.

Shape letters: F images, N candidates, C channels.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from goshawk_dashboards.state.views import PlanView
from goshawk_proto import goshawk_pb2 as pb
from numpy.typing import NDArray
from scipy.spatial import KDTree

from goshawk_train.config import CameraConfig, DepthConfig, LatticeConfig
from goshawk_train.data import DataError
from goshawk_train.data.flown.fuse import Fused
from goshawk_train.data.flown.recording import Recording
from goshawk_train.data.foreign.resample import OURS
from goshawk_train.data.preprocess import fill_depth, normalise_depth
from goshawk_train.model import geometry
from goshawk_train.model.card import CONTRACT_KEY

F64 = NDArray[np.float64]
Mask = NDArray[np.bool_]

Reason = Literal["near-miss", "lost", "doubt", "disagree"]
REASONS: dict[Reason, str] = {
    "near-miss": "in the second before the lens came within 0.7 m of an obstacle",
    "lost": "from 2 s before the target was lost until it was found",
    "doubt": "an objectness between 0.1 and 0.9, or two ways far apart at nearly the same cost",
    "disagree": "the cheapest candidates of the flown policy and of --other end 2 m apart, or only one sees a target",
}
_NEAR_M, _BEFORE_NEAR_S = 0.7, 1.0
_BEFORE_LOST_S, _AFTER_LOST_S = 2.0, 0.2
_DOUBTFUL = (0.1, 0.9)
_APART_M, _MARGIN = 3.0, 0.02
"""Two candidates whose ends lie so far apart and whose costs differ by less than this share of the costs' scale."""
_DIFFERS_M = 2.0
"""Two policies differ whose cheapest candidates end so far apart."""
_COST, _OBJECTNESS = 9, 10


def near_miss(recording: Recording, frames_F: NDArray[np.int64], fused: Fused) -> Mask:
    """Before an obstacle was near: then it was decided."""
    if not len(fused.points_P3):
        return np.zeros(len(frames_F), dtype=bool)
    tree = cast("Any", KDTree(fused.points_P3))
    distance_F = tree.query(recording.pos_world_F3[frames_F])[0]
    return _around(recording.time_F[frames_F], distance_F < _NEAR_M, before_s=_BEFORE_NEAR_S, after_s=0.0)


def lost(recording: Recording, frames_F: NDArray[np.int64]) -> Mask:
    """Around each loss of the target."""
    time_F = recording.time_F[frames_F]
    found = np.zeros(len(frames_F), dtype=bool)
    for phase in recording.flight.phases:
        if phase.name == "lost":
            found |= (time_F >= phase.start_s - _BEFORE_LOST_S) & (time_F <= phase.end_s + _AFTER_LOST_S)
    return found


def doubt(recording: Recording, frames_F: NDArray[np.int64]) -> Mask:
    """Where the network's own answer was not clear."""

    def doubtful(plan: PlanView) -> bool:
        if plan.target_pos_world_N3 is not None and _DOUBTFUL[0] < plan.objectness_N.max() < _DOUBTFUL[1]:
            return True
        best = int(plan.cost_N.argmin())
        apart = np.linalg.norm(plan.end_pos_world_N3 - plan.end_pos_world_N3[best], axis=1) > _APART_M
        return bool((plan.cost_N[apart] - plan.cost_N[best] < _MARGIN * recording.cost_scale).any())

    plans = recording.plans
    return np.array([int(f) in plans and doubtful(plans[int(f)]) for f in frames_F], dtype=bool)


class Other:
    """Another policy, asked what it makes of the images and states of a flight."""

    def __init__(self, path: Path) -> None:
        """Raises `DataError` if it is no policy, or one that sees other images."""
        import onnxruntime

        try:
            one = cast("Any", onnxruntime).SessionOptions()
            one.intra_op_num_threads = 1
            providers = ["CPUExecutionProvider"]
            self.session = cast("Any", onnxruntime.InferenceSession(str(path), one, providers=providers))
            properties = self.session.get_modelmeta().custom_metadata_map
            self.contract = json.loads(properties[CONTRACT_KEY])
            image, depth = self.contract["image"], self.contract["depth"]
            self.depth = DepthConfig(min_m=depth["min_m"], max_m=depth["max_m"], fill_passes=depth["fill_passes"])
            size = (image["width"], image["height"])
        except Exception as error:  # ONNX Runtime has no one class of errors
            raise DataError(f"{path} is no policy that `goshawk train export` wrote") from error
        if size != (OURS.width, OURS.height):
            raise DataError(f"{path} sees images of {size[0]} x {size[1]}, the log's are {OURS.width} x {OURS.height}")
        self.path = path

    def differs(self, recording: Recording, frames_F: NDArray[np.int64]) -> Mask:
        """Where its answer is another; raises `DataError` if the flown policy was told other things than it is."""
        if recording.contract.get("state") != self.contract["state"] or recording.task != self.contract["task"]:
            raise DataError(f"{self.path} is told other things than the policy that flew {recording.flight.path}")
        inputs, plans = _planner_inputs(recording), recording.plans
        found = np.zeros(len(frames_F), dtype=bool)
        for place, frame in enumerate(frames_F.tolist()):
            given = inputs.get(plans[frame].seq) if frame in plans else None
            if given is None:
                continue
            flown = np.array(given.prediction, dtype=np.float64).reshape(-1, len(plans[frame].cost_N))
            filled = normalise_depth(fill_depth(recording.depth(frame), self.depth), self.depth)
            rgbd = np.concatenate([np.moveaxis(recording.rgb(frame), -1, 0) / np.float32(255), filled[None]])
            state = np.array([given.state], dtype=np.float32)
            answer = self.session.run(["prediction"], {"rgbd": rgbd[None], "state": state})[0]
            found[place] = self._differ(flown, answer[0].reshape(len(flown), -1).astype(np.float64), recording)
        return found

    def _differ(self, flown_CN: F64, own_CN: F64, recording: Recording) -> bool:
        apart_m = np.linalg.norm(_choice(own_CN, self.contract) - _choice(flown_CN, recording.contract))
        if recording.task != "track":
            return bool(apart_m > _DIFFERS_M)
        sees, saw = (bool(answer[_OBJECTNESS].max() > 0) for answer in (own_CN, flown_CN))
        return bool(apart_m > _DIFFERS_M) or sees != saw


def _choice(answer_CN: F64, contract: dict[str, Any]) -> F64:
    """Where a policy's cheapest candidate ends (eq. 4-6), camera frame."""
    image, shape = contract["image"], contract["lattice"]
    lattice = LatticeConfig(**shape)
    camera = CameraConfig(**image, tilt_rad=contract["camera_tilt_rad"])
    best = int(answer_CN[_COST].argmin())
    elevation, azimuth = (angles[best] for angles in geometry.anchor_angles(camera, lattice))
    up, left, farther = np.tanh(answer_CN[:3, best])
    way = geometry.direction(elevation + up * lattice.elevation_offset_rad, azimuth + left * lattice.azimuth_offset_rad)
    return lattice.radius_m * (1 + farther) * way


def _planner_inputs(recording: Recording) -> dict[int, pb.PlannerInput]:
    """What the planner was given, by its plan's number."""
    flight = recording.flight
    found: dict[int, pb.PlannerInput] = {}
    for number in range(flight.count("planner_input")):
        given = flight.message("planner_input", number)
        if isinstance(given, pb.PlannerInput):
            found[given.seq] = given
    return found


def _around(time_F: F64, mask_F: Mask, *, before_s: float, after_s: float) -> Mask:
    """The mask, and what is so near before and after it."""
    out = np.zeros(len(mask_F), dtype=bool)
    for time in time_F[mask_F]:
        out |= (time_F >= time - before_s) & (time_F <= time + after_s)
    return out
