"""Random motion states for the images (section III-E, training dataset), in units of v_max and a_max.

States are drawn in the level frame of the camera's heading (x forward, z world-up), then turned into the camera's.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from goshawk_train.config import SamplingConfig

F64 = NDArray[np.float64]


def sample_velocity(rng: np.random.Generator, count: int, config: SamplingConfig) -> F64:
    """Level-frame velocities [count, 3]: forward log-normal below `velocity_limit`, sideways and up normal."""
    log_mean = math.log(config.velocity_limit - config.velocity_mean) - config.velocity_log_std**2 / 2

    def draw(n: int) -> F64:
        forward = config.velocity_limit - rng.lognormal(log_mean, config.velocity_log_std, n)
        return np.column_stack([forward, rng.normal(0.0, config.velocity_std, (n, 2))])

    def keep(v: F64) -> NDArray[np.bool_]:
        return (v[:, 0] > config.velocity_min) & (np.linalg.norm(v, axis=1) < config.norm_max)

    return _rejection(draw, keep, count)


def sample_acceleration(rng: np.random.Generator, count: int, config: SamplingConfig) -> F64:
    """Level-frame accelerations [count, 3], normal, norms cut at `norm_max`."""

    def draw(n: int) -> F64:
        return rng.normal(0.0, config.acceleration_std, (n, 3))

    def keep(a: F64) -> NDArray[np.bool_]:
        return np.linalg.norm(a, axis=1) < config.norm_max

    return _rejection(draw, keep, count)


def sample_aim(rng: np.random.Generator, height_B: F64, reach_m: float, config: SamplingConfig) -> F64:
    """Aims [B, 3] in the level frame, m, for cameras `height_B` above the ground: at any distance within reach, a share
    of `aim_far` at the end of it, a share of `aim_anywhere` in whatever direction, the others more or less ahead, at
    heights above the ground in `aim_height_m`, less sure the farther away."""
    count = len(height_B)
    distance = reach_m * np.where(rng.uniform(size=count) < config.aim_far, 1.0, rng.uniform(size=count))
    ahead, anywhere = rng.normal(0.0, config.aim_yaw_std_rad, count), rng.uniform(-math.pi, math.pi, count)
    yaw = np.where(rng.uniform(size=count) < config.aim_anywhere, anywhere, ahead)
    up = rng.uniform(*config.aim_height_m, count) - height_B + rng.normal(0.0, config.aim_height_std, count) * distance
    return np.column_stack([distance * np.cos(yaw), distance * np.sin(yaw), up])


def chase_aim(rng: np.random.Generator, target_rel_B3: F64, config: SamplingConfig) -> F64:
    """Aims [B, 3] after targets, both relative to the camera in world axes, m: some way off the target, where it may be
    by the trajectory's end; from there `chase_standoff_m` back towards the camera (never behind it) and
    `chase_height_m` up."""
    ahead = target_rel_B3.copy()
    ahead[:, :2] += rng.normal(0.0, config.chase_spread_m, (len(ahead), 2))
    flat = np.linalg.norm(ahead[:, :2], axis=1, keepdims=True)
    ahead[:, :2] *= np.maximum(flat - config.chase_standoff_m, 0) / np.maximum(flat, 1e-6)
    ahead[:, 2] += config.chase_height_m
    return ahead


def sample_agility(rng: np.random.Generator, count: int, config: SamplingConfig) -> F64:
    """Shares of a_max that vehicles can give [count]: `agility_max` for a share of `agility_full`, the others down to
    `agility_min`, uniform in the logarithm."""
    less = np.exp(rng.uniform(math.log(config.agility_min), math.log(config.agility_max), count))
    return np.where(rng.uniform(size=count) < config.agility_full, config.agility_max, less)


def within_reach(aim_B3: F64, reach_m: float) -> F64:
    """Aims shortened to `reach_m` where they are longer."""
    length = np.linalg.norm(aim_B3, axis=1, keepdims=True)
    return aim_B3 * np.minimum(1, reach_m / np.maximum(length, 1e-6))


def _rejection(draw: Callable[[int], F64], keep: Callable[[F64], NDArray[np.bool_]], count: int) -> F64:
    """Draw until `count` are kept."""
    kept: list[F64] = []
    have = 0
    while have < count:
        batch = draw(2 * count + 16)
        batch = batch[keep(batch)]
        kept.append(batch)
        have += len(batch)
    return np.concatenate(kept)[:count]
