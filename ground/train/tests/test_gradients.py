"""The paper's closed-form gradients (sections III-D and III-E) against automatic differentiation, in float64."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from goshawk_train.config import Config
from goshawk_train.costs.batch import Situation
from goshawk_train.costs.esdf import VOXEL_M, SceneGrid, SceneMaps, signed_distance
from goshawk_train.costs.trajectory import CostModel, boundary_vectors
from goshawk_train.model import quintic
from goshawk_train.model.decode import Decoder

F64 = torch.float64


@pytest.fixture(scope="module")
def maps() -> SceneMaps:
    """Two scenes of scattered obstacles, different in shape and origin."""
    grids: list[SceneGrid] = []
    for scene, shape in enumerate([(70, 60, 24), (64, 80, 20)]):
        rng = np.random.default_rng(scene)
        occupied = rng.uniform(size=shape) < 0.0015
        origin = np.array([-7.0 + scene, -6.0, -1.0])
        ground = rng.uniform(-0.2, 0.2, (40, 40)).astype(np.float32)
        grids.append(
            SceneGrid(
                distance_XYZ=signed_distance(occupied, voxel_m=VOXEL_M),
                distance_origin=origin,
                ground_XY=ground,
                ground_origin=origin[:2],
                ground_cell_m=0.5,
            )
        )
    return SceneMaps(grids, storage=torch.float32)


@pytest.fixture
def d() -> torch.Tensor:
    """Boundary vectors [2, 15, 6, 3]."""
    generator = torch.Generator().manual_seed(0)
    scale = torch.tensor([0.0, 2.0, 2.0, 3.0, 2.0, 2.0], dtype=F64)[:, None]
    return (torch.randn(2, 15, 6, 3, generator=generator, dtype=F64) * scale).requires_grad_()


def situation() -> Situation:
    return Situation(
        pos_world_B3=torch.tensor([[0.1, 0.2, 1.0], [0.3, -0.4, 1.2]], dtype=F64),
        scene_B=torch.tensor([0, 1]),
        aim_rel_B3=torch.tensor([[4.0, 1.0, 0.2], [3.0, -2.0, 0.1]], dtype=F64),
        agility_B=torch.tensor([1.0, 0.5], dtype=F64),
    )


def final_gradient(value: torch.Tensor, d: torch.Tensor) -> torch.Tensor:
    (gradient,) = torch.autograd.grad(value.sum(), d)
    return gradient[:, :, 3:]


def test_smoothness_gradient_is_twice_df_bfp_plus_dp_bpp(config: Config, maps: SceneMaps, d: torch.Tensor) -> None:
    model = CostModel(config, maps, dtype=F64)
    b = model.smooth_66
    closed = 2 * torch.einsum("bnic,ij->bnjc", d[:, :, :3], b[:3, 3:])
    closed = closed + 2 * torch.einsum("bnic,ij->bnjc", d[:, :, 3:], b[3:, 3:])
    torch.testing.assert_close(final_gradient(model.smoothness(d), d), closed)


def test_smoothness_is_the_integral_of_squared_jerk_and_acceleration(config: Config, maps: SceneMaps) -> None:
    d = torch.randn(1, 1, 6, 3, dtype=F64)
    coefficients = quintic.hermite(config.duration_s) @ d[0, 0].numpy()
    times = np.linspace(0, config.duration_s, 20001)
    integral = 0.0
    for order, weight in ((3, config.costs.jerk / 6.0**5), (2, config.costs.acceleration / 6.0**3)):
        rows = np.stack([quintic.derivative_row(t, order) for t in times])
        integral += weight * np.trapezoid(((rows @ coefficients) ** 2).sum(1), times)
    value = float(CostModel(config, maps, dtype=F64).smoothness(d)[0, 0])
    assert value == pytest.approx(integral, rel=1e-6)


def test_safety_gradient_is_the_sum_of_potential_slopes_times_lp(
    config: Config, maps: SceneMaps, d: torch.Tensor
) -> None:
    config = dataclasses.replace(config, costs=dataclasses.replace(config.costs, potential_rest=1.0))
    model, where = CostModel(config, maps, dtype=F64), situation()
    duration, samples = config.duration_s, config.costs.samples
    lp = quintic.hermite(duration)[:, 3:]
    closed = torch.zeros(2, 15, 3, 3, dtype=F64)
    for k in range(1, samples + 1):
        t_row = quintic.derivative_row(duration * k / samples, 0)
        m = torch.tensor(t_row @ quintic.hermite(duration))
        pos = torch.einsum("i,bnic->bnc", m, d.detach()) + where.pos_world_B3[:, None]
        flat = pos.reshape(-1, 3).requires_grad_()
        scene = where.scene_B.repeat_interleave(15)
        distance = maps.clearance(flat, scene)
        (slope,) = torch.autograd.grad(distance.sum(), flat)
        potential = torch.exp(-(distance.detach() - config.costs.potential_distance_m) / 0.6)
        slope = -potential[:, None] / config.costs.potential_scale_m * slope
        closed += torch.einsum("bnc,j->bnjc", slope.view(2, 15, 3), torch.tensor(t_row @ lp)) * duration / samples
    gradient = final_gradient(model(d, where).safety_BN, d)
    torch.testing.assert_close(gradient, closed * config.costs.collision, rtol=1e-9, atol=1e-12)


def test_trilinear_slope_is_the_finite_difference(maps: SceneMaps) -> None:
    generator = torch.Generator().manual_seed(1)
    point = (torch.rand(200, 3, generator=generator, dtype=F64) - 0.5) * torch.tensor([8.0, 8.0, 2.0]) + 0.5
    scene = torch.arange(200) % 2
    leaf = point.clone().requires_grad_()
    (slope,) = torch.autograd.grad(maps.clearance(leaf, scene).sum(), leaf)
    step = 1e-6
    for axis in range(3):
        offset = torch.zeros(3, dtype=F64)
        offset[axis] = step
        numeric = (maps.clearance(point + offset, scene) - maps.clearance(point - offset, scene)) / (2 * step)
        torch.testing.assert_close(slope[:, axis], numeric, rtol=1e-6, atol=1e-6)


def test_goal_gradient_pulls_toward_the_aim_with_a_slope_of_one_at_most(
    config: Config, maps: SceneMaps, d: torch.Tensor
) -> None:
    where = situation()
    gradient = final_gradient(CostModel(config, maps, dtype=F64)(d, where).goal_BN, d)
    miss = (d[:, :, 3] - where.aim_rel_B3[:, None]).detach()
    flat = miss[..., :2].square().sum(-1, keepdim=True).sqrt()
    assert (flat > 1).any() and (miss[..., 2].abs() > 1).any()
    closed = torch.cat([miss[..., :2] / flat.clamp_min(1), miss[..., 2:].clamp(-1, 1)], dim=-1)
    torch.testing.assert_close(gradient[:, :, 0], config.costs.goal * closed, rtol=1e-6, atol=0)
    assert gradient[:, :, 1:].abs().max() == 0


def test_idling_costs_the_missing_way_in_whatever_direction(config: Config, maps: SceneMaps) -> None:
    model, aim = CostModel(config, maps, dtype=F64), torch.tensor([[8.0, 0.0, 0.5]], dtype=F64)
    ends = torch.tensor([[[0.0, 0.0, 0.0], [0.0, 5.0, 0.0], [3.0, -4.0, 1.0], [8.0, 1.0, 0.0]]], dtype=F64)
    torch.testing.assert_close(
        model.idle(ends, aim)[0], torch.tensor([7.5, 2.5, 2.5, 0.0], dtype=F64), atol=1e-4, rtol=0
    )


def test_a_less_agile_vehicle_is_given_less_acceleration(config: Config, maps: SceneMaps, d: torch.Tensor) -> None:
    model, agile = CostModel(config, maps, dtype=F64), situation()
    sluggish = dataclasses.replace(agile, agility_B=agile.agility_B / 2)
    a, b = model(d, agile), model(d, sluggish)
    torch.testing.assert_close(b.smoothness_BN, 2 * a.smoothness_BN)
    assert (b.feasibility_BN > a.feasibility_BN).any() and (b.feasibility_BN >= a.feasibility_BN).all()
    torch.testing.assert_close(b.safety_BN, a.safety_BN)


def test_a_less_agile_vehicle_keeps_farther_off(config: Config, maps: SceneMaps, d: torch.Tensor) -> None:
    costs = dataclasses.replace(config.costs, clearance=8.0, clearance_m=0.3, clearance_agility=1.0)
    terms = CostModel(dataclasses.replace(config, costs=costs), maps, dtype=F64)(d, situation())
    for scene, agility in enumerate([1.0, 0.5]):
        short = (1 - terms.min_distance_BN[scene] / (0.3 / agility)).clamp(min=0)
        torch.testing.assert_close(terms.clearance_BN[scene], 8.0 / agility * short.square())
        assert (short > 0).any() and (short < 1).any()


def test_who_has_acceleration_to_spare_turns_at_less_cost_and_keeps_farther_off(
    config: Config, maps: SceneMaps, d: torch.Tensor
) -> None:
    costs = dataclasses.replace(
        config.costs, clearance=8.0, clearance_m=0.3, clearance_agility=1.0, clearance_spare=1.2
    )
    model, able = CostModel(dataclasses.replace(config, costs=costs), maps, dtype=F64), situation()
    ample = dataclasses.replace(able, agility_B=4 * torch.ones_like(able.agility_B))
    full = dataclasses.replace(able, agility_B=torch.ones_like(able.agility_B))
    a, b = model(d, ample), model(d, full)
    torch.testing.assert_close(8 * a.smoothness_BN, b.smoothness_BN)
    for terms, care in ((a, 0.25 + 4.8), (b, 1 + 1.2)):
        short = (1 - terms.min_distance_BN / (0.3 * care)).clamp(min=0)
        torch.testing.assert_close(terms.clearance_BN, 8.0 * care * short.square())
    assert (a.clearance_BN > b.clearance_BN).any()


def test_rest_costs_less_near_obstacles_than_speed(config: Config, maps: SceneMaps) -> None:
    model, where = CostModel(config, maps, dtype=F64), situation()
    at_rest = torch.zeros(2, 1, 6, 3, dtype=F64)
    always = dataclasses.replace(config, costs=dataclasses.replace(config.costs, potential_rest=1.0))
    share = model(at_rest, where).safety_BN / CostModel(always, maps, dtype=F64)(at_rest, where).safety_BN
    torch.testing.assert_close(share, torch.full_like(share, config.costs.potential_rest), rtol=1e-3, atol=0)


def test_chain_rule_through_decoding_is_jacobian_times_tanh_slope(config: Config, maps: SceneMaps) -> None:
    """dJ/dy = dJ/ddP * ddP/d(offset) * d * (1 - tanh^2), written out for every raw output."""
    decoder, model, where = Decoder(config, dtype=F64), CostModel(config, maps, dtype=F64), situation()
    generator = torch.Generator().manual_seed(2)
    raw = (torch.randn(2, 14, 3, 5, generator=generator, dtype=F64) * 0.5).requires_grad_()
    state = torch.randn(2, 2, 3, generator=generator, dtype=F64)
    rotation = torch.eye(3, dtype=F64).expand(2, 3, 3)
    end = decoder(raw).end_cam_BN33
    cost = model(boundary_vectors(state[:, 0], state[:, 1], end, rotation), where).trajectory_BN().sum()
    dj_ddp, dj_dy = torch.autograd.grad(cost, [end, raw])

    y = raw.detach().flatten(2).transpose(1, 2)
    t = torch.tanh(y[..., :9])
    lattice, motion = config.lattice, config.motion
    theta = decoder.elevation_N + t[..., 0] * lattice.elevation_offset_rad
    phi = decoder.azimuth_N + t[..., 1] * lattice.azimuth_offset_rad
    r = lattice.radius_m * (1 + t[..., 2])
    st, ct, sp, cp = theta.sin(), theta.cos(), phi.sin(), phi.cos()
    closed = torch.zeros(2, 15, 14, dtype=F64)
    d_theta = torch.stack([-r * st * cp, -r * st * sp, r * ct], -1)
    d_phi = torch.stack([-r * ct * sp, r * ct * cp, torch.zeros_like(r)], -1)
    d_r = torch.stack([ct * cp, ct * sp, st], -1)
    reach = [lattice.elevation_offset_rad, lattice.azimuth_offset_rad, lattice.radius_m]
    for channel, (direction, scale) in enumerate(zip((d_theta, d_phi, d_r), reach, strict=True)):
        closed[..., channel] = (dj_ddp[:, :, 0] * direction).sum(-1) * scale
    cell = torch.einsum("bndi,nij->bndj", dj_ddp[:, :, 1:], decoder.cam_from_cell_N33)
    closed[..., 3:6] = cell[:, :, 0] * motion.v_max_mps
    closed[..., 6:9] = cell[:, :, 1] * motion.a_max_mps2
    closed[..., :9] *= 1 - t**2
    torch.testing.assert_close(dj_dy.flatten(2).transpose(1, 2), closed, rtol=1e-9, atol=1e-12)


def test_trajectory_through_an_obstacle_costs_decidedly_more(config: Config) -> None:
    """A trunk of 0.2 m radius 3 m ahead: straight through against 1.2 m beside it, everything else equal."""
    axis = np.arange(60) * VOXEL_M - 2.0
    gap = np.hypot(axis[:, None] - 3.0, axis[None, :]) - 0.2
    occupied = np.repeat((gap < 0.1)[:, :, None], 20, axis=2)
    grid = SceneGrid(
        distance_XYZ=signed_distance(occupied, voxel_m=VOXEL_M),
        distance_origin=np.array([-2.0, -2.0, 0.0]),
        ground_XY=np.full((30, 30), -1.0, dtype=np.float32),
        ground_origin=np.array([-2.0, -2.0]),
        ground_cell_m=0.5,
    )
    model = CostModel(config, SceneMaps([grid]))
    d = torch.zeros(1, 2, 6, 3)
    d[:, :, 1, 0] = d[:, :, 4, 0] = 3.6
    d[:, :, 3, 0] = 6.0
    where = dataclasses.replace(
        situation(),
        pos_world_B3=torch.tensor([[0.0, 0.0, 1.5]]),
        scene_B=torch.tensor([0]),
        aim_rel_B3=torch.tensor([[6.0, 0.0, 0.0]]),
        agility_B=torch.tensor([1.0]),
    )
    through = model(d, where)
    beside = model(d, dataclasses.replace(where, pos_world_B3=torch.tensor([[0.0, 1.5, 1.5]])))
    assert float(through.min_distance_BN[0, 0]) < 0 < float(beside.min_distance_BN[0, 0])
    difference = through.trajectory_BN()[0, 0] - beside.trajectory_BN()[0, 0]
    assert float(difference) > 5.0
