"""Costs of predicted trajectories (section III-E), differentiable, at alpha = 1.

Shape letters: B batch, N anchors, K samples in time, 6 the boundary vector [p0 v0 a0 pT vT aT], 3 an FLU or ENU vector.
Boundary vectors are in world axes with the camera's position as origin.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import torch
import torch.nn.functional as F
from torch import Tensor

from goshawk_train.config import Config
from goshawk_train.costs.batch import Situation
from goshawk_train.costs.esdf import SceneMaps
from goshawk_train.model import quintic


@dataclass(frozen=True, kw_only=True)
class CostTerms:
    """Weighted terms, [B, N] each, and the closest approach that they come from."""

    smoothness_BN: Tensor
    safety_BN: Tensor
    clearance_BN: Tensor
    feasibility_BN: Tensor
    ground_BN: Tensor
    goal_BN: Tensor
    progress_BN: Tensor
    idle_BN: Tensor
    min_distance_BN: Tensor
    pos_rel_BNK3: Tensor

    def parts_BN(self) -> dict[str, Tensor]:
        """What the trajectory's cost is the sum of, by name."""
        return {
            "smoothness": self.smoothness_BN,
            "safety": self.safety_BN,
            "clearance": self.clearance_BN,
            "feasibility": self.feasibility_BN,
            "ground": self.ground_BN,
            "goal": self.goal_BN,
            "progress": self.progress_BN,
            "idle": self.idle_BN,
        }

    def trajectory_BN(self) -> Tensor:
        """The sum of all terms."""
        return reduce(torch.add, self.parts_BN().values())


class CostModel:
    """The constants of the costs and the privileged maps."""

    def __init__(self, config: Config, maps: SceneMaps, *, dtype: torch.dtype = torch.float32) -> None:
        self.config, self.maps = config, maps
        duration, costs, v_max = config.duration_s, config.costs, config.motion.v_max_mps
        jerk = costs.jerk / v_max**5 * quintic.gram(duration, 3)
        acceleration = costs.acceleration / v_max**3 * quintic.gram(duration, 2)
        self.smooth_66 = torch.tensor(jerk + acceleration, dtype=dtype)
        """Symmetric; B of the paper for both derivatives, weights included."""
        self.rows_3K6 = torch.tensor(quintic.sample_rows(duration, costs.samples), dtype=dtype)
        self.step_s = duration / costs.samples

    def smoothness(self, d_BN63: Tensor) -> Tensor:
        """Js: weighted integrals of squared jerk and acceleration, closed form, for a vehicle that can give a_max."""
        return torch.einsum("ij,bnic,bnjc->bn", self.smooth_66, d_BN63, d_BN63)

    def potential(self, distance: Tensor) -> Tensor:
        """c(d) = exp(-(d - d0) / r0)."""
        costs = self.config.costs
        return torch.exp(-(distance - costs.potential_distance_m) / costs.potential_scale_m)

    def __call__(self, d_BN63: Tensor, situation: Situation) -> CostTerms:
        """All terms of trajectories given by their boundary vectors."""
        costs, motion = self.config.costs, self.config.motion
        pos, vel, acc = torch.einsum("oki,bnic->obnkc", self.rows_3K6, d_BN63).unbind(0)
        world = pos + situation.pos_world_B3[:, None, None]
        flat = world.reshape(-1, 3)
        scene = situation.scene_B[:, None, None].expand(pos.shape[:3]).reshape(-1)
        distance = self.maps.clearance(flat, scene).view(pos.shape[:3])
        speed = _norm(vel) / motion.v_max_mps
        exposure = costs.potential_rest + (1 - costs.potential_rest) * speed
        safety = costs.collision * self.step_s * (self.potential(distance) * exposure).sum(-1)
        min_distance = distance.amin(-1)
        above = world[..., 2] - self.maps.ground(flat, scene).view(pos.shape[:3])
        ground = F.softplus((costs.ground_distance_m - above) / costs.ground_scale_m)
        agility = situation.agility_B[:, None]
        care = agility**-costs.clearance_agility + costs.clearance_spare * agility
        short = F.relu(1 - min_distance / (costs.clearance_m * care))
        fast = F.relu(speed.amax(-1) - 1)
        hard = F.relu(_norm(acc).amax(-1) / (motion.a_max_mps2 * agility) - 1)
        return CostTerms(
            smoothness_BN=self.smoothness(d_BN63) / (agility * agility.clamp_min(1).sqrt()),
            safety_BN=safety,
            clearance_BN=costs.clearance * care * short.square(),
            feasibility_BN=costs.feasibility * (_excess(fast) + _excess(hard)),
            ground_BN=costs.ground * self.step_s * ground.sum(-1),
            goal_BN=costs.goal * self.goal(d_BN63[:, :, 3], situation.aim_rel_B3[:, None]),
            progress_BN=costs.progress * self.miss(pos, situation.aim_rel_B3[:, None, None]).mean(-1),
            idle_BN=costs.idle * self.idle(d_BN63[:, :, 3], situation.aim_rel_B3),
            min_distance_BN=min_distance,
            pos_rel_BNK3=pos,
        )

    def goal(self, end_rel: Tensor, aim_rel: Tensor) -> Tensor:
        """Jg of ends [..., 3]: the squared distance from the aim (eq. Jg), or what `miss` says."""
        if self.config.costs.goal_rule == "paper":
            return (end_rel - aim_rel).square().sum(-1)
        return self.miss(end_rel, aim_rel)

    def miss(self, pos_rel: Tensor, aim_rel: Tensor) -> Tensor:
        """Smooth-L1 distance of positions [..., 3] from the aim, horizontal and vertical apart: each has a slope of
        1 however far the aim is, so that the way over the trees is no shorter than the one around them.

        At the end alone it would leave open when to set out: from rest, a quintic that ends a little too fast first
        waits, and one that is planned anew at each frame waits for ever. Hence the mean along the way, `progress`.
        """
        off = pos_rel - aim_rel
        parts = torch.stack([_norm(off[..., :2]), off[..., 2]], dim=-1)
        return F.smooth_l1_loss(parts, torch.zeros_like(parts), reduction="none").sum(-1)

    def idle(self, end_rel_BN3: Tensor, aim_rel_B3: Tensor) -> Tensor:
        """How much shorter the way is than the one to the aim, smooth-L1, in the plane and in whatever direction.

        Before something wide no way leads nearer to the aim; this lets one go aside rather than hover there for ever.
        """
        short = F.relu(_norm(aim_rel_B3[:, None, :2]) - _norm(end_rel_BN3[..., :2]))
        return F.smooth_l1_loss(short, torch.zeros_like(short), reduction="none")


def _excess(e: Tensor) -> Tensor:
    """e² up to 1, linear beyond: what cannot be flown in any way must not drown the rest."""
    return 2 * F.smooth_l1_loss(e, torch.zeros_like(e), reduction="none")


def _norm(v: Tensor) -> Tensor:
    """Length of the last axis with a gradient at zero."""
    return (v.square().sum(-1) + 1e-9).sqrt()


def boundary_vectors(
    velocity_cam_B3: Tensor, acceleration_cam_B3: Tensor, end_cam_BN33: Tensor, world_from_cam_B33: Tensor
) -> Tensor:
    """d [B, N, 6, 3] in world axes, the camera's position as origin, from camera-frame states."""
    start = torch.stack([torch.zeros_like(velocity_cam_B3), velocity_cam_B3, acceleration_cam_B3], dim=1)
    d_cam = torch.cat([start[:, None].expand(-1, end_cam_BN33.shape[1], -1, -1), end_cam_BN33], dim=2)
    return torch.einsum("bij,bndj->bndi", world_from_cam_B33, d_cam)
