"""The paper's own method (sections III-B to III-E), as `paper.toml` and `paper-navigate.toml` have it."""

from __future__ import annotations

import colorsys
import dataclasses
import json
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch
from command import goshawk
from goshawk_train.config import Config, ConfigError, config_from_dict, config_to_dict, load_config
from goshawk_train.costs.esdf import SceneMaps
from goshawk_train.data import augment, batches
from goshawk_train.model import checkpoint, export
from goshawk_train.model.card import CONTRACT_KEY
from goshawk_train.model.network import Policy
from goshawk_train.run import score, train, validate
from goshawk_train.run.beginning import of_policy, of_run

CONFIGS = Path(__file__).parents[1] / "configs"
SIMULATOR = Path(__file__).parents[3] / "target" / "release" / "goshawk-sim"
BEYOND = ("clearance", "feasibility", "progress", "idle")
"""Terms of the cost that the paper does not have."""


def made_small(config: Config, small: Config) -> Config:
    network = dataclasses.replace(small.network, state=config.network.state)
    training = dataclasses.replace(small.training, bf16=False)
    return dataclasses.replace(config, network=network, training=training)


@pytest.fixture(scope="module")
def paper(small: Config) -> Config:
    return made_small(load_config(CONFIGS / "paper.toml"), small)


@pytest.fixture(scope="module")
def loaded(paper: Config, dataset: Path) -> tuple[batches.Frames, SceneMaps]:
    return batches.load(dataset, paper)


def trainer(config: Config, loaded: tuple[batches.Frames, SceneMaps]) -> train.Trainer:
    return train.Trainer(config, *loaded, data_name="synthetic")


def seen(config: Config, loaded: tuple[batches.Frames, SceneMaps]) -> batches.Batch:
    rng = np.random.default_rng(0)
    return batches.make_batch(loaded[0], np.arange(len(loaded[0])), rng, config, training=False)


def test_the_configurations_are_the_papers() -> None:
    track, navigate = (load_config(CONFIGS / f"{name}.toml") for name in ("paper", "paper-navigate"))
    assert sum(track.state_sizes.values()) == 6
    assert track.network.channels == (64, 128, 256, 512)
    assert navigate.network.state == ("velocity", "acceleration", "direction")
    for config in (track, navigate):
        assert (config.costs.lambda_other, config.costs.lambda_negative) == (0.2, 0.5)
        assert config.costs.potential_rest == 1.0
        assert [getattr(config.costs, name) for name in BEYOND] == [0.0] * len(BEYOND)
        assert config.augment.space == "hsv"


def test_the_goal_pulls_positive_anchors_alone_and_is_no_part_of_the_predicted_cost(
    paper: Config, loaded: tuple[batches.Frames, SceneMaps]
) -> None:
    run, batch = trainer(paper, loaded), seen(paper, loaded)
    raw = torch.zeros(len(batch.state_BS), 14, 3, 5, requires_grad=True)
    outcome = run.losses(raw, batch)
    positive = outcome.assignment.positive_BN
    assert positive.any(1).any() and (positive.sum(1) <= 1).all(), "the cell that holds the target"
    terms = outcome.terms
    torch.testing.assert_close(outcome.label_BN, (terms.trajectory_BN() - terms.goal_BN).detach().clamp_max(40.0))
    far = dataclasses.replace(batch.situation, aim_rel_B3=batch.situation.aim_rel_B3 + 3.0)

    def gradient(batch: batches.Batch) -> torch.Tensor:
        (found,) = torch.autograd.grad(run.losses(raw, batch).loss, raw)
        return found[:, 2].flatten(1)  # the radius

    moved = gradient(batch) != gradient(dataclasses.replace(batch, situation=far))
    assert torch.equal(moved, positive)


def test_the_goal_cost_is_the_squared_distance_from_the_target(
    paper: Config, loaded: tuple[batches.Frames, SceneMaps]
) -> None:
    run, batch = trainer(paper, loaded), seen(paper, loaded)
    outcome = run.losses(torch.zeros(len(batch.state_BS), 14, 3, 5), batch)
    has_target = batch.visible_B > 0
    end_BN3 = outcome.decoded.end_cam_BN33[:, :, 0]
    squared = (end_BN3 - batch.target_net_B3[:, None]).square().sum(-1)
    torch.testing.assert_close(outcome.terms.goal_BN[has_target], paper.costs.goal * squared[has_target])


def test_what_holds_no_target_counts_a_fifth(paper: Config, loaded: tuple[batches.Frames, SceneMaps]) -> None:
    run, batch = trainer(paper, loaded), seen(paper, loaded)
    raw = torch.zeros(len(batch.state_BS), 14, 3, 5, requires_grad=True)
    (found,) = torch.autograd.grad(run.losses(raw, batch).loss, raw)
    positive = run.losses(raw, batch).assignment.positive_BN
    of_cost = found[:, 9].flatten(1).abs()  # smooth L1 far from its label has the slope of its weight
    share = of_cost[positive].max() / of_cost[~positive].max()
    assert float(share) == pytest.approx(5.0, rel=0.01)


def test_in_navigation_all_trajectories_are_pulled_toward_a_direction(
    small: Config, loaded: tuple[batches.Frames, SceneMaps]
) -> None:
    config = made_small(load_config(CONFIGS / "paper-navigate.toml"), small)
    run, batch = trainer(config, loaded), seen(config, loaded)
    outcome = run.losses(torch.zeros(len(batch.state_BS), 10, 3, 5), batch)
    torch.testing.assert_close(outcome.label_BN, outcome.terms.trajectory_BN().clamp_max(40.0))
    torch.testing.assert_close(batch.state_BS[:, 6:9].norm(dim=1), torch.ones(len(batch.state_BS)))
    level = np.linalg.norm(batch.situation.aim_rel_B3[:, :2].numpy(), axis=1)
    np.testing.assert_allclose(level, config.reach_m, rtol=1e-5)


def test_a_state_without_an_aim_wants_the_papers_goal_and_navigation_a_direction(paper: Config) -> None:
    def changed(section: str, **values: object) -> dict[str, object]:
        table = config_to_dict(paper)
        table[section] |= values
        return table

    with pytest.raises(ConfigError, match="goal_rule"):
        config_from_dict(changed("costs", goal_rule="aim"))
    with pytest.raises(ConfigError, match="aim or a direction"):
        config_from_dict({**config_to_dict(paper), "task": "navigate"})
    for state in (["acceleration", "velocity"], ["velocity", "acceleration", "agility", "up"], ["velocity"]):
        with pytest.raises(ConfigError, match=r"network\.state"):
            config_from_dict(changed("network", state=state))


def test_colours_are_changed_as_in_hsv() -> None:
    rgb = torch.rand(4, 6, 5, 3, generator=torch.Generator().manual_seed(0))
    rgb[0, 0, 0] = torch.tensor([0.4, 0.4, 0.4])
    jitter = augment.Jitter(
        hue=np.array([0.0, 0.3, -0.35, 2.0]),
        saturation=np.array([1.0, 0.7, 1.3, 1.0]),
        value=np.array([1.0, 1.2, 0.8, 1.0]),
    )
    out = augment.jitter_hsv(rgb, jitter)
    for image in range(4):
        for pixel, got in zip(rgb[image].reshape(-1, 3).numpy(), out[image].reshape(-1, 3).numpy(), strict=True):
            hue, saturation, value = colorsys.rgb_to_hsv(float(pixel[0]), float(pixel[1]), float(pixel[2]))
            hue = (hue + jitter.hue[image] / (2 * np.pi)) % 1
            saturation = min(saturation * jitter.saturation[image], 1.0)
            want = colorsys.hsv_to_rgb(hue, saturation, min(value * jitter.value[image], 1.0))
            np.testing.assert_allclose(got, want, atol=1e-5)


def test_half_a_file_says_nearly_the_same_and_can_be_begun_from(
    paper: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    run = trainer(paper, loaded)
    run.advance()
    whole, half = tmp_path / "whole.onnx", tmp_path / "half.onnx"
    for path in (whole, half):
        agreed = export.export(run.snapshot(), path, commit="abc", cost_scale=6.5, half=path == half)
        assert agreed["state"] == ["velocity", "acceleration"]
    assert half.stat().st_size < 0.6 * whole.stat().st_size
    properties = {entry.key: entry.value for entry in onnx.load(str(half)).metadata_props}
    assert json.loads(properties[CONTRACT_KEY])["state"] == ["velocity", "acceleration"]
    begun, exact = of_policy(half).weights, of_policy(whole).weights
    assert begun.keys() == exact.keys()
    for name, weight in exact.items():
        torch.testing.assert_close(begun[name], weight, rtol=1e-3, atol=1e-4)
    with pytest.raises(export.ExportError, match="differs"):
        export.verify(Policy(paper).eval(), half, paper, agreement=export.AGREEMENT_HALF)


def test_a_run_whose_state_tells_no_way_is_scored_in_the_chase_alone(
    paper: Config, loaded: tuple[batches.Frames, SceneMaps], dataset: Path
) -> None:
    run = trainer(paper, loaded)
    run.advance()
    shares = score.score(run.snapshot(), SIMULATOR, validate.Validator(paper, dataset), trials=1, threads=1)
    assert set(shares) == {"track_4", "track_7", "all"}


def test_a_run_whose_state_tells_no_way_is_not_exported_for_navigation(
    paper: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    checkpoint.save(tmp_path / checkpoint.FILE, trainer(paper, loaded).snapshot())
    out = tmp_path / "navigate.onnx"
    done = goshawk("train", "export", "--run", tmp_path, "--data", tmp_path, "--task", "navigate", "--out", out)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1) and "no aim and no direction" in done.stderr
    assert not out.exists()


def test_a_run_begins_with_each_input_of_the_state_by_its_name(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    """Ours has up, aim and agility after the paper's, whose navigation has a direction there."""
    papers = made_small(load_config(CONFIGS / "paper-navigate.toml"), small)
    for begun, other in ((small, papers), (papers, small)):
        first, second = trainer(other, loaded), trainer(begun, loaded)
        checkpoint.save(tmp_path / checkpoint.FILE, first.snapshot())
        second.begin_from(of_run(tmp_path / checkpoint.FILE))
        theirs, own = (run.network.state_dict()["head1.weight"] for run in (first, second))
        shared = theirs.shape[1] - sum(other.state_sizes.values()) + 6
        assert torch.equal(own[:, :shared], theirs[:, :shared])
        assert own[:, shared:].abs().max() == 0
