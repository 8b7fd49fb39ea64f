"""Pictures of what a policy does: camera image, and the candidates on a top view of the true map."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import numpy as np
import torch
from matplotlib import pyplot
from matplotlib.axes import Axes

from goshawk_train.config import Config
from goshawk_train.costs.batch import Batch
from goshawk_train.costs.esdf import SceneMaps
from goshawk_train.costs.losses import LossModel, Outcome
from goshawk_train.costs.trajectory import CostModel
from goshawk_train.data import DataError, batches
from goshawk_train.model.network import Policy

_REACH_M = 11.0


def draw(network: Policy, config: Config, root: Path, out: Path, *, count: int, seed: int) -> None:
    """One PNG: for each of `count` frames the image, the top view and the side view with all candidates."""
    frames, maps = batches.load(root, config)
    if count > len(frames):
        raise DataError(f"{root} has {len(frames)} frames, not {count}; draw fewer")
    losses = LossModel(config, CostModel(config, maps))
    rng = np.random.default_rng(seed)
    index = rng.choice(len(frames), count, replace=False)
    batch = batches.make_batch(frames, index, rng, config, training=False)
    network.eval()
    with torch.no_grad():
        outcome = losses(network(batch.rgbd_I4HW, batch.state_BS), batch)
    figure, axes = pyplot.subplots(count, 3, figsize=(15, 4.6 * count), squeeze=False)
    for row in range(count):
        axes[row, 0].imshow(frames.rgb_FHW3[index[row]], extent=(0, config.camera.width, config.camera.height, 0))
        _cells(axes[row, 0], outcome, row, config)
        for column, axis in ((1, 1), (2, 2)):
            _candidates(axes[row, column], outcome, batch, maps, row, axis)
    figure.tight_layout()
    out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(out, format="png", dpi=60)
    pyplot.close(figure)


def _cells(axes: Axes, outcome: Outcome, row: int, config: Config) -> None:
    cell = config.camera.width / config.lattice.columns
    for anchor in range(config.lattice.anchors):
        x, y = anchor % config.lattice.columns * cell, anchor // config.lattice.columns * cell
        text = f"{float(outcome.decoded.cost_BN[row, anchor]):.1f} ({float(outcome.label_BN[row, anchor]):.1f})"
        if outcome.decoded.objectness_logit_BN is not None:
            text += f"\n{float(torch.sigmoid(outcome.decoded.objectness_logit_BN[row, anchor])):.2f}"
        positive = bool(outcome.assignment.positive_BN[row, anchor])
        axes.text(x + 1, y + 9, text, color="yellow" if positive else "white", fontsize=8)
        axes.axvline(x, color="white", linewidth=0.3)
        axes.axhline(y, color="white", linewidth=0.3)
    axes.set_title("cost (true cost), objectness")


def _candidates(axes: Axes, outcome: Outcome, batch: Batch, maps: SceneMaps, row: int, axis: int) -> None:
    """World x against y (axis 1) or z (axis 2), the camera at the origin, obstacles on the vehicle's level or lane."""
    situation = batch.situation
    grid = np.arange(-_REACH_M, _REACH_M, 0.1)
    across = grid if axis == 1 else np.arange(-3, 4, 0.1)
    forward = batch.world_from_net_B33[row, :2, 0].numpy()
    forward = forward / max(float(np.linalg.norm(forward)), 1e-6)
    a, b = np.meshgrid(grid, across)
    points = np.zeros((a.size, 3))
    if axis == 1:
        points[:, 0], points[:, 1] = a.ravel(), b.ravel()
    else:
        points[:, :2], points[:, 2] = a.ravel()[:, None] * forward, b.ravel()
    world = torch.as_tensor(points, dtype=torch.float32) + situation.pos_world_B3[row]
    scene = situation.scene_B[row].expand(len(world))
    distance = maps.clearance(world, scene).numpy().reshape(a.shape)
    axes.contourf(a, b, distance, levels=[-5, 0, 0.16, 0.6, 1.2, 30], colors=["k", "0.45", "0.7", "0.85", "1.0"])

    def flat(pos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return (pos[..., 0], pos[..., 1]) if axis == 1 else (pos[..., :2] @ forward, pos[..., 2])

    best = int(outcome.decoded.cost_BN[row].argmin())
    for anchor in range(outcome.label_BN.shape[1]):
        positive = bool(outcome.assignment.positive_BN[row, anchor])
        colour = "tab:green" if positive else "tab:blue" if anchor == best else "tab:red"
        path = np.vstack([np.zeros(3), outcome.terms.pos_rel_BNK3[row, anchor].numpy()])
        axes.plot(*flat(path), color=colour, linewidth=2 if positive else 0.9)
    if float(batch.visible_B[row]) > 0:
        target = (batch.world_from_net_B33[row] @ batch.target_net_B3[row]).numpy()
        axes.plot(*flat(target), "m*", markersize=12)
    axes.plot(*flat(situation.aim_rel_B3[row].numpy()), "c+", markersize=12)
    axes.set_aspect("equal")
