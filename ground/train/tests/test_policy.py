"""Decoding, assignment, sampling, augmentation and the network's inner rotation."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import cast

import numpy as np
import pytest
import torch
from goshawk_train.config import Config, ConfigError, config_from_dict, config_to_dict, load_config
from goshawk_train.costs.assign import assign
from goshawk_train.data import augment, batches, sampling
from goshawk_train.model import geometry
from goshawk_train.model.decode import Decoder
from goshawk_train.model.network import Policy, cell_state_matrix
from hypothesis import given, settings
from hypothesis import strategies as st

ROOT = Path(__file__).parents[1]
F64 = torch.float64


def test_zero_output_decodes_to_the_anchors_at_rest(config: Config) -> None:
    decoded = Decoder(config, dtype=F64)(torch.zeros(1, 14, 3, 5, dtype=F64))
    elevation, azimuth = geometry.anchor_angles(config.camera, config.lattice)
    end = decoded.end_cam_BN33[0].numpy()
    np.testing.assert_allclose(end[:, 0], 5 * geometry.direction(elevation, azimuth), atol=1e-12)
    assert np.abs(end[:, 1:]).max() == 0
    assert end[0, 0, 1] > 0 and end[0, 0, 2] > 0, "anchor 0 is up left"
    np.testing.assert_allclose(end[7, 0], [5, 0, 0], atol=1e-12)


def test_end_velocity_is_given_in_the_cell_frame(config: Config) -> None:
    raw = torch.zeros(1, 14, 3, 5, dtype=F64)
    raw[:, 3] = 20.0  # tanh is 1: full speed along each anchor
    decoded = Decoder(config, dtype=F64)(raw)
    elevation, azimuth = geometry.anchor_angles(config.camera, config.lattice)
    velocity = decoded.end_cam_BN33[0, :, 1].numpy()
    np.testing.assert_allclose(velocity, 6 * geometry.direction(elevation, azimuth), atol=1e-9)


@given(anchor=st.integers(0, 14), du=st.floats(-0.45, 1.45), dv=st.floats(-0.45, 1.45), depth=st.floats(0.5, 15))
@settings(max_examples=50, deadline=None)
def test_target_decoding_inverts_projection(anchor: int, du: float, dv: float, depth: float) -> None:
    config = load_config(ROOT / "configs" / "track.toml")
    raw = torch.zeros(1, 14, 15, dtype=F64)
    logit = [float(np.log((o + 0.5) / 2 / (1 - (o + 0.5) / 2))) for o in (du, dv)]
    raw[0, 11, anchor], raw[0, 12, anchor] = logit
    raw[0, 13, anchor] = float(np.log(np.expm1(depth / 5)))
    target = Decoder(config, dtype=F64)(raw.view(1, 14, 3, 5)).target_cam_BN3
    assert target is not None
    u, v = geometry.project(target[0, anchor].numpy(), config.camera)
    assert float(target[0, anchor, 0]) == pytest.approx(depth)
    assert float(u) == pytest.approx((anchor % 5 + du) * 32, abs=1e-6)
    assert float(v) == pytest.approx((anchor // 5 + dv) * 32, abs=1e-6)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: float(np.linalg.norm(q)) > 0.1))
@settings(max_examples=50, deadline=None)
def test_levelling_takes_out_the_heading_only(q: list[float]) -> None:
    rotation = geometry.matrix_from_quaternion(np.array(q))
    level = geometry.level_from_cam(rotation)
    np.testing.assert_allclose(level @ level.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(level[2], rotation[2], atol=1e-12)
    assert abs(level[1, 0]) < 1e-9 and level[0, 0] >= 0


def test_network_rotates_the_state_into_every_cell(config: Config) -> None:
    state = np.random.default_rng(0).normal(size=13)
    rotated = (cell_state_matrix(config) @ state).reshape(13, 15)
    assert (rotated[12] == state[12]).all()
    cells = geometry.cam_from_cell(config.camera, config.lattice)
    for anchor in range(15):
        for vector in range(4):
            expected = cells[anchor].T @ state[3 * vector : 3 * vector + 3]
            np.testing.assert_allclose(rotated[3 * vector : 3 * vector + 3, anchor], expected, atol=1e-12)


@pytest.mark.parametrize("task", ["track", "navigate"])
def test_network_output_has_a_channel_for_each_name(task: str) -> None:
    config = load_config(ROOT / "configs" / f"{task}.toml")
    state = torch.zeros(2, 13)
    assert Policy(config)(torch.zeros(2, 4, 96, 160), state).shape == (2, len(config.channel_names), 3, 5)


def at(config: Config, u: float, v: float, depth: float) -> torch.Tensor:
    f = config.camera.focal_px
    return torch.tensor([[depth, (80 - u) / f * depth, (48 - v) / f * depth]])


def test_cell_that_holds_the_projection_is_positive(config: Config) -> None:
    for anchor in range(15):
        u, v = (anchor % 5) * 32 + 16.0, (anchor // 5) * 32 + 16.0
        groups = assign(at(config, u, v, 8.0), torch.ones(1), config)
        assert groups.positive_BN[0].nonzero().flatten().tolist() == [anchor]


def test_neighbours_are_positive_within_0p3_m_and_ignored_within_0p8_m(config: Config) -> None:
    # 0.2 m left of the border between columns 1 and 2, 4 m away: 4 px
    groups = assign(at(config, 60.0, 48.0, 4.0), torch.ones(1), config)
    assert groups.positive_BN[0].nonzero().flatten().tolist() == [6, 7]
    # 0.5 m left of it: 10 px; 0.8 m from the upper row: 16 px at least
    groups = assign(at(config, 54.0, 48.0, 4.0), torch.ones(1), config)
    assert groups.positive_BN[0].nonzero().flatten().tolist() == [6]
    assert groups.ignored_BN[0].nonzero().flatten().tolist() == [1, 7, 11]


def test_hardly_visible_target_is_ignored_and_an_absent_one_negative(config: Config) -> None:
    target = at(config, 80.0, 48.0, 3.0).repeat(2, 1)
    groups = assign(target, torch.tensor([0.1, 0.0]), config)
    assert not groups.positive_BN.any()
    assert groups.ignored_BN[0, 7] and groups.negative_BN[1].all()


@given(u=st.floats(-30, 190), v=st.floats(-30, 120), depth=st.floats(-3, 20), visible=st.floats(0, 1))
@settings(max_examples=100, deadline=None)
def test_every_anchor_is_exactly_one_of_three(u: float, v: float, depth: float, visible: float) -> None:
    config = load_config(ROOT / "configs" / "track.toml")
    groups = assign(at(config, u, v, depth), torch.tensor([visible]), config)
    total = groups.positive_BN.int() + groups.ignored_BN.int() + groups.negative_BN.int()
    assert (total == 1).all()


def test_sampled_states_have_the_configured_distribution(config: Config) -> None:
    rng = np.random.default_rng(0)
    velocity = sampling.sample_velocity(rng, 20000, config.sampling)
    assert np.linalg.norm(velocity, axis=1).max() < 1.2
    assert velocity[:, 0].mean() == pytest.approx(0.45, abs=0.08)
    assert velocity[:, 1].std() == pytest.approx(0.42, abs=0.05)
    assert abs(velocity[:, 1].mean()) < 0.02
    assert (velocity[:, 0] > 0.9).mean() > 0.02, "full speed is covered"
    acceleration = sampling.sample_acceleration(rng, 20000, config.sampling)
    assert np.linalg.norm(acceleration, axis=1).max() < 1.2
    assert abs(acceleration.mean()) < 0.02


def test_chase_aim_stands_off_and_never_backs_away(config: Config) -> None:
    still = dataclasses.replace(config.sampling, chase_spread_m=0.0)
    targets = np.array([[3.0, 4.0, 0.5], [1.0, 0.0, -0.2], [30.0, 0.0, 0.0]])
    aim = sampling.chase_aim(np.random.default_rng(0), targets, still)
    np.testing.assert_allclose(aim[0], [1.8, 2.4, 0.8])
    np.testing.assert_allclose(aim[1], [0.0, 0.0, 0.1], atol=1e-12)
    assert np.linalg.norm(sampling.within_reach(aim, 10.0)[2]) == pytest.approx(10.0)


def test_aims_lie_ahead_at_flying_height_and_often_at_the_end_of_the_reach(config: Config) -> None:
    aim = sampling.sample_aim(np.random.default_rng(0), np.full(20000, 1.4), 10.0, config.sampling)
    distance, height = np.linalg.norm(aim[:, :2], axis=1), aim[:, 2] + 1.4
    assert (distance > 9.99).mean() == pytest.approx(config.sampling.aim_far, abs=0.02)
    assert (distance < 2).mean() > 0.1 and (aim[:, 0] < 0).mean() == pytest.approx(
        config.sampling.aim_anywhere / 2, abs=0.02
    )
    assert height.mean() == pytest.approx(np.mean(config.sampling.aim_height_m), abs=0.05)


@pytest.mark.parametrize("greatest", [1.0, 3.0])
def test_agility_is_the_greatest_or_less_down_to_the_least(config: Config, greatest: float) -> None:
    how = dataclasses.replace(config.sampling, agility_max=greatest)
    agility = sampling.sample_agility(np.random.default_rng(0), 20000, how)
    assert (agility == greatest).mean() == pytest.approx(how.agility_full, abs=0.02)
    assert how.agility_min <= agility.min() < 1.05 * how.agility_min
    assert agility.max() == greatest


def test_detection_does_not_depend_on_the_task_and_trajectories_do(config: Config) -> None:
    torch.manual_seed(0)
    network = Policy(config).eval()
    state = torch.randn(1, 13)
    image = torch.rand(1, 4, 96, 160)
    other = torch.cat([state[:, :9], torch.randn(1, 4)], dim=1)
    with torch.no_grad():
        a, b = network(image, state), network(image, other)
    assert torch.equal(a[:, 10:], b[:, 10:])
    assert (a[:, :10] != b[:, :10]).any(dim=0).any(dim=0).all()


def test_colour_matrices_turn_hue_and_keep_grey_grey(config: Config) -> None:
    matrix = augment.colour_matrices(augment.draw_jitter(np.random.default_rng(0), 100, config.augment))
    grey = matrix @ np.ones(3)
    np.testing.assert_allclose(grey, np.repeat(grey[:, :1], 3, axis=1), atol=1e-9)
    red = matrix @ np.array([1.0, 0.0, 0.0])
    turn = (augment.hue_of(red) - augment.hue_of(np.array([1.0, 0.0, 0.0])) + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(turn).max() < config.augment.hue_rad + 0.1 and turn.std() > 0.1


def test_blanking_takes_rgb_or_depth_never_both(config: Config) -> None:
    image = torch.full((4000, 2, 2, 4), 0.5)
    out = augment.augment(image, np.random.default_rng(0), config.augment, count=len(image), part=slice(None))
    no_rgb, no_depth = out[:, 0, 0, 0] == 0, out[:, 0, 0, 3] == 1
    assert not (no_rgb & no_depth).any()
    assert float(no_rgb.float().mean()) == pytest.approx(config.augment.blank_rgb, abs=0.02)
    assert float(no_depth.float().mean()) == pytest.approx(config.augment.blank_depth, abs=0.02)


def test_mirrored_sample_is_the_mirror_image_with_the_same_world(config: Config, dataset: Path) -> None:
    """The target, seen in the mirrored frame and mapped back, is where it was; pixels follow it."""
    frames, _ = batches.load(dataset, config)
    plain = batches.make_batch(frames, np.arange(8), np.random.default_rng(0), config, training=False)
    for seed in range(20):
        flipped = batches.make_batch(frames, np.arange(8), np.random.default_rng(seed), config, training=True)
        mirrored = cast("torch.Tensor", torch.linalg.det(flipped.world_from_net_B33)) < 0
        if mirrored.any() and not mirrored.all():
            break
    else:
        pytest.fail("no mirrored sample drawn")
    back = torch.einsum("bij,bj->bi", flipped.world_from_net_B33, flipped.target_net_B3)
    there = torch.einsum("bij,bj->bi", plain.world_from_net_B33, plain.target_net_B3)
    torch.testing.assert_close(back, there, rtol=0, atol=1e-4)
    assert torch.allclose(flipped.target_net_B3[mirrored, 1], -plain.target_net_B3[mirrored, 1], atol=1e-4)
    depth = flipped.rgbd_I4HW[:, 3]
    kept = (depth < 1).flatten(1).any(1)  # not blanked
    assert (mirrored & kept).any() and (~mirrored & kept).any()
    assert torch.equal(depth[mirrored & kept], plain.rgbd_I4HW[mirrored & kept, 3].flip(-1))
    assert torch.equal(depth[~mirrored & kept], plain.rgbd_I4HW[~mirrored & kept, 3])


def test_unknown_missing_and_wrong_fields_are_refused(config: Config) -> None:
    table = config_to_dict(config)
    assert config_from_dict(table) == config
    for change, message in (
        ({"extra": 1}, "unknown field extra"),
        ({"seed": "one"}, "seed must be of type int"),
        ({"costs": {**table["costs"], "jerk": float("nan")}}, r"costs\.jerk"),
        ({"costs": {k: v for k, v in table["costs"].items() if k != "jerk"}}, r"costs\.jerk is missing"),
        ({"camera": {**table["camera"], "width": 128}}, "32 px"),
        ({"seed": -1}, "seed must not be below 0"),
        ({"sampling": {**table["sampling"], "norm_max": 0.0}}, r"sampling\.norm_max must be above 0"),
        ({"sampling": {**table["sampling"], "velocity_limit": 0.0}}, r"sampling\.velocity_limit must be above"),
        ({"training": {**table["training"], "validate_frames": 0}}, r"training\.validate_frames must be above 0"),
    ):
        with pytest.raises(ConfigError, match=message):
            config_from_dict({**table, **change})


def test_decoding_agrees_with_the_shared_vectors(config: Config) -> None:
    """Training decodes at alpha = 1 in the camera frame; the vectors are in the world, at several speeds."""
    document = json.loads((ROOT.parents[1] / "tests" / "vectors" / "decode.json").read_text())
    assert len(document["cases_B"]) > 1
    for case in document["cases_B"]:
        raw = torch.tensor(case["raw_CN"], dtype=F64).view(1, -1, 3, 5)
        decoded = Decoder(config, dtype=F64)(raw)
        assert decoded.target_cam_BN3 is not None and decoded.objectness_logit_BN is not None
        rotation = geometry.matrix_from_quaternion(np.array(case["world_from_cam_Q"]))
        body = geometry.matrix_from_quaternion(np.array(case["world_from_body_Q"]))
        start = np.array(case["pos_3"])
        lens = start + body @ np.array(case["lens_body_3"])
        alpha = case["speed"] / config.motion.v_max_mps
        end = decoded.end_cam_BN33[0].numpy() @ rotation.T * np.array([1, alpha, alpha**2])[:, None]
        target = decoded.target_cam_BN3[0].numpy() @ rotation.T + lens
        objectness = torch.sigmoid(decoded.objectness_logit_BN[0])
        assert len(case["candidates_N"]) == len(end)
        for anchor, expected in enumerate(case["candidates_N"]):
            np.testing.assert_allclose(end[anchor, 0] + start, expected["end_pos"], atol=1e-9)
            np.testing.assert_allclose(end[anchor, 1], expected["end_vel"], atol=1e-9)
            np.testing.assert_allclose(end[anchor, 2], expected["end_acc"], atol=1e-9)
            np.testing.assert_allclose(target[anchor], expected["target"], atol=1e-9)
            assert float(decoded.cost_BN[0, anchor]) == pytest.approx(expected["cost"], abs=1e-9)
            assert float(objectness[anchor]) == pytest.approx(expected["objectness"], abs=1e-9)
