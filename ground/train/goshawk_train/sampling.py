"""Random motion states for the images (section III-E, training dataset), in units of v_max and a_max.

States are drawn in the level frame of the camera's heading (x forward, z world-up), then turned into the camera's.
"""

from __future__ import annotations

import math

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
    return _rejection(
        lambda n: rng.normal(0.0, config.acceleration_std, (n, 3)),
        lambda a: np.linalg.norm(a, axis=1) < config.norm_max,
        count,
    )


def sample_goal(rng: np.random.Generator, count: int, config: SamplingConfig) -> F64:
    """Level-frame unit directions to a goal [count, 3]."""
    yaw = rng.normal(0.0, config.goal_yaw_std_rad, count)
    pitch = rng.normal(0.0, config.goal_pitch_std_rad, count)
    return np.column_stack([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])


def _rejection(draw, keep, count: int) -> F64:
    """Draw until `count` are kept."""
    kept: list[F64] = []
    have = 0
    while have < count:
        batch = draw(2 * count + 16)
        batch = batch[keep(batch)]
        kept.append(batch)
        have += len(batch)
    return np.concatenate(kept)[:count]
