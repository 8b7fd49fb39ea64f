"""How good a policy is on held-out scenes: detection, trajectories, and whether its costs rank them right.

Shape letters: F frames, B batch, N anchors, 3 FLU.
"""

from __future__ import annotations

from pathlib import Path
from typing import cast

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import stats

from goshawk_train.config import Config
from goshawk_train.costs.batch import Batch
from goshawk_train.costs.losses import LossModel, Outcome
from goshawk_train.costs.trajectory import CostModel
from goshawk_train.data import batches
from goshawk_train.model.checkpoint import Checkpoint, load_weights
from goshawk_train.model.network import Policy

COLLISION_M = 0.16
"""Radius of the vehicle's collision sphere."""
_BATCH = 64
_SEED = 20_000


class Validator:
    """Held-out data with fixed states, for comparable figures over a run."""

    def __init__(self, config: Config, root: Path) -> None:
        self.config = config
        self.frames, maps = batches.load(root, config)
        self.losses = LossModel(config, CostModel(config, maps))
        count = min(len(self.frames), config.training.validate_frames)
        self.index_F = np.sort(np.random.default_rng(_SEED).choice(len(self.frames), count, replace=False))

    def evaluate_state(self, saved: Checkpoint) -> dict[str, float]:
        """Metrics of a checkpoint's averaged weights."""
        network = Policy(self.config)
        load_weights(network, saved)
        return self.evaluate(network)

    def cost_scale(self, saved: Checkpoint) -> float:
        """How far apart a checkpoint's costs are, for its policy's contract: three digits of `cost_spread_p50`."""
        return float(f"{self.evaluate_state(saved)['cost_spread_p50']:.3g}")

    def evaluate(self, network: Policy) -> dict[str, float]:
        """Metrics of a network; it is put into evaluation mode."""
        network.eval()
        collected: dict[str, list[NDArray[np.float64]]] = {}
        for start in range(0, len(self.index_F), _BATCH):
            rng = np.random.default_rng([_SEED, start])
            batch = batches.make_batch(
                self.frames, self.index_F[start : start + _BATCH], rng, self.config, training=False
            )
            with torch.no_grad():
                outcome = self.losses(network(batch.rgbd_I4HW, batch.state_BS), batch)
            for name, values in batch_metrics(outcome, batch, self.config).items():
                collected.setdefault(name, []).append(values)
        return summary({name: np.concatenate(values) for name, values in collected.items()})


def _array(value: torch.Tensor) -> NDArray[np.float64]:
    return value.double().numpy()


def rank_correlation(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Spearman's correlation of two rows; 0 where one is constant."""
    if a.std() == 0 or b.std() == 0:
        return 0.0
    ranks = [cast("NDArray[np.float64]", stats.rankdata(x)) for x in (a, b)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def batch_metrics(outcome: Outcome, batch: Batch, config: Config) -> dict[str, NDArray[np.float64]]:
    """Raw values to be pooled over batches; each a flat array of one entry per frame, anchor or detection."""
    terms, decoded = outcome.terms, outcome.decoded
    tracking = config.task == "track"
    hit: NDArray[np.bool_] = (terms.min_distance_BN < COLLISION_M).numpy()
    label, predicted = _array(outcome.label_BN), _array(decoded.cost_BN)
    frame = np.arange(len(label))
    end = _array(terms.pos_rel_BNK3[:, :, -1])
    aim = _array(batch.situation.aim_rel_B3)
    cheapest = predicted.argmin(1)
    missed = np.linalg.norm(end[frame, cheapest] - aim, axis=1)
    rank = [rank_correlation(label[b], predicted[b]) for b in frame]
    out = {
        "loss": np.full(len(label), float(outcome.loss)),
        "collide_all": hit.ravel().astype(float),
        "collide_cheapest": hit[frame, cheapest].astype(float),
        "label_cheapest": label[frame, cheapest],
        "label_best": label.min(1),
        "aim_missed": missed,
        "aim_missed_height": np.abs(end[frame, cheapest, 2] - aim[:, 2]),
        "cost_rank": np.array(rank),
        "cost_spread": predicted.max(1) - predicted.min(1),
        "cost_error": np.abs(label - predicted).ravel(),
        "cost_label_hit": label[hit],
        "cost_label_clear": label[~hit],
        "cost_hit": predicted[hit],
        "cost_clear": predicted[~hit],
        **{f"term_{name}": _array(part_BN)[frame, cheapest] for name, part_BN in terms.parts_BN().items()},
    }
    if not tracking or decoded.objectness_logit_BN is None or decoded.target_cam_BN3 is None:
        return out
    positive = outcome.assignment.positive_BN.numpy()
    seen = positive.any(1)
    score_BN = torch.sigmoid(decoded.objectness_logit_BN)
    score = _array(score_BN)
    found: NDArray[np.bool_] = (score_BN > 0.5).numpy()
    target = _array(batch.target_net_B3)
    best = np.where(positive, score, -1).argmax(1)
    error = _array(decoded.target_cam_BN3)[frame, best] - target
    ray = target / np.maximum(np.linalg.norm(target, axis=1, keepdims=True), 1e-6)
    along = (error * ray).sum(1)
    negative = outcome.assignment.negative_BN.numpy()
    return out | {
        "recall": np.asarray((found & positive).any(1))[seen].astype(float),
        "false_alarm_empty": np.asarray(found.any(1))[_array(batch.visible_B) == 0].astype(float),
        "false_alarm_cell": found[negative].astype(float),
        "distance_error": along[seen],
        "lateral_error": np.linalg.norm(error - along[:, None] * ray, axis=1)[seen],
    }


def summary(pooled: dict[str, NDArray[np.float64]]) -> dict[str, float]:
    """Means, and for errors the median and 95th percentile of the absolute value; what had no entry is left out."""
    out: dict[str, float] = {}
    for name, values in pooled.items():
        if not len(values):
            continue
        if name in ("distance_error", "lateral_error", "cost_error", "cost_spread", "aim_missed", "aim_missed_height"):
            out[f"{name}_p50"] = float(np.median(np.abs(values)))
            out[f"{name}_p95"] = float(np.percentile(np.abs(values), 95))
        else:
            out[name] = float(values.mean())
    return out


def table(metrics: dict[str, float]) -> str:
    """Metrics as text, a name and a figure a row."""
    width = max(len(name) for name in metrics)
    return "\n".join(f"  {name:<{width}} {value:10.4f}" for name, value in metrics.items())
