"""Signals that no channel holds as such: speeds, distances, angles, errors. Each is read from a whole flight. Pure.

Shape suffixes: M samples, 3 a vector, 4 a quaternion (w, x, y, z).
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from goshawk_dashboards.charts.clearance import seen_clearance
from goshawk_dashboards.charts.errors import target_errors
from goshawk_dashboards.log.flight import TARGET_FIELDS, Columns, Flight
from goshawk_dashboards.page import theme
from goshawk_dashboards.state.views import Array

Series = tuple[Array, Array]
"""Times, s, and values; NaN where there is none."""

CONTROL_FIELDS = (
    "pos_world", "vel_world", "acc_meas_world", "acc_des_world", "acc_att_world", "acc_disturbance_world",
    "world_from_body", "world_from_body_des", "plan_age_s", "thrust_norm", "hover_thrust",
)  # fmt: skip
AXES = ("east", "north", "up")
ANGLES = ("roll", "pitch", "yaw")


@dataclass(frozen=True, kw_only=True)
class Derived:
    """How a signal is read, and how it looks."""

    unit: str
    rgb: theme.Rgb
    read: Callable[[Flight], Series]
    dashed: bool = False


def _control(flight: Flight) -> Columns:
    return flight.columns("control", CONTROL_FIELDS)


def _scaled(field: str, by: float) -> Callable[[Flight], Series]:
    return lambda flight: (_control(flight).times_s, by * _control(flight)[field])


def _speed(flight: Flight) -> Series:
    own = _control(flight)
    return own.times_s, np.linalg.norm(own["vel_world"], axis=1)


def _held(flight: Flight, values_M: Array) -> Series:
    """What is of the target counts while the filter holds one."""
    target = flight.columns("target", TARGET_FIELDS)
    return target.times_s, np.where(target["confirmed"].astype(bool), values_M, np.nan)


def _target_speed(flight: Flight) -> Series:
    return _held(flight, np.linalg.norm(flight.columns("target", TARGET_FIELDS)["vel_world"], axis=1))


def _distance(flight: Flight) -> Series:
    own, target = _control(flight), flight.columns("target", TARGET_FIELDS)
    if len(own) == 0 or len(target) == 0:
        return np.zeros(0), np.zeros(0)
    there_M3 = np.stack([np.interp(target.times_s, own.times_s, own["pos_world"][:, k]) for k in range(3)], axis=1)
    return _held(flight, np.linalg.norm(target["pos_world"] - there_M3, axis=1))


def _truth(field: str, flight: Flight) -> Series:
    truth = flight.columns("sim_truth", [field])
    return truth.times_s, truth[field].astype(np.float64)


def _clearance(flight: Flight) -> Series:
    seen = seen_clearance(flight)
    return (np.zeros(0), np.zeros(0)) if seen is None else (seen.times_s_M, seen.nearest_m_M)


def _along(field: str, axis: int, flight: Flight) -> Series:
    return _control(flight).times_s, _control(flight)[field][:, axis]


def _acceleration(field: str, axis: int, flight: Flight) -> Series:
    times_s, values = _along(field, axis, flight)
    return _in_air(flight, times_s, values)


def _true_acceleration(axis: int, flight: Flight) -> Series:
    truth = flight.columns("sim_truth", ["acc_world"])
    return _in_air(flight, truth.times_s, truth["acc_world"][:, axis])


def _in_air(flight: Flight, times_s_M: Array, values_M: Array) -> Series:
    """Without what is told on the ground: a thrust that ramps up there looks like a fall, or like a disturbance."""
    return times_s_M, np.where(flight.airborne_M(times_s_M), values_M, np.nan)


def _angle(field: str, axis: int, flight: Flight) -> Series:
    return _control(flight).times_s, np.degrees(angles_M3(_control(flight)[field])[:, axis])


def _tilt(flight: Flight) -> Series:
    q_M4 = _control(flight)["world_from_body"]
    return _control(flight).times_s, np.degrees(np.arccos(np.clip(1.0 - 2.0 * (q_M4[:, 1:3] ** 2).sum(axis=1), -1, 1)))


def _attitude_error(flight: Flight) -> Series:
    own = _control(flight)
    cosine_M = np.abs((own["world_from_body"] * own["world_from_body_des"]).sum(axis=1))
    return own.times_s, np.degrees(2.0 * np.arccos(np.clip(cosine_M, 0.0, 1.0)))


def _rate(axis: int, flight: Flight) -> Series:
    imu = flight.columns("imu", ["ang_vel_body"])
    return imu.times_s, np.degrees(imu["ang_vel_body"][:, axis])


def _rate_asked(axis: int, flight: Flight) -> Series:
    """How fast the attitude asked for turns, in the body's axes, from step to step."""
    own = _control(flight)
    q_M4 = own["world_from_body_des"]
    if len(q_M4) < 2:
        return np.zeros(0), np.zeros(0)
    turn_M4 = _times(q_M4[:-1] * (1.0, -1.0, -1.0, -1.0), q_M4[1:])
    turn_M4 = turn_M4 * np.where(turn_M4[:, :1] < 0.0, -1.0, 1.0)
    step_s_M = np.diff(own.times_s)
    rate_M = 2.0 * turn_M4[:, 1 + axis] / np.where(step_s_M > 0.0, step_s_M, np.nan)
    # A controller's step repeats what it held before: the mean of 50 ms is what the autopilot can follow.
    window = max(1, round(0.05 / max(float(np.median(step_s_M)), 1e-4)))
    return own.times_s[1:], np.degrees(np.convolve(rate_M, np.ones(window) / window, mode="same"))


def angles_M3(q_M4: NDArray[Any]) -> Array:
    """Roll to the right, pitch nose down (the body's y is left) and yaw to the left, rad."""
    w, x, y, z = q_M4.T
    return np.stack(
        [
            np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
            np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        ],
        axis=1,
    )


def _times(a_M4: NDArray[Any], b_M4: NDArray[Any]) -> Array:
    """Products of quaternions."""
    aw, ax, ay, az = a_M4.T
    bw, bx, by, bz = b_M4.T
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=1,
    )


def _sigma(flight: Flight) -> Series:
    """Along the longest axis of what the filter does not know of the target's place."""
    target = flight.columns("target", [f"covariance_upper.{k}" for k in (0, 1, 2, 6, 7, 11)])
    xx, xy, xz, yy, yz, zz = target.fields.values()
    cov_M33 = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    known = np.isfinite(cov_M33).all(axis=(1, 2))
    sigma_M = np.full(len(target), np.nan)
    sigma_M[known] = np.sqrt(np.maximum(np.linalg.eigvalsh(cov_M33[known])[:, -1], 0.0))
    return target.times_s, sigma_M


def _target_error(flight: Flight) -> Series:
    errors = target_errors(flight)
    if errors is None:
        return np.zeros(0), np.zeros(0)
    return errors.times_s_M, np.hypot(errors.lateral_m_M, errors.longitudinal_m_M)


def _battery(flight: Flight) -> Series:
    told = flight.columns("controller_input", ["battery"])
    return told.times_s, 100.0 * told["battery"]


def _doubt(flight: Flight) -> Series:
    told = flight.columns("control", ["odometry_doubt"])
    return told.times_s, told["odometry_doubt"]


def thrust_limits(flight: Flight) -> tuple[float, float] | None:
    """The least and the most that is commanded, of full thrust; None: the vehicle file does not tell."""
    try:
        airframe = tomllib.loads(flight.header.vehicle_toml)["airframe"]
        return float(airframe["min_thrust"]), float(airframe["max_thrust"])
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError):
        return None


def _thrust_limit(which: int, flight: Flight) -> Series:
    limits, times_s = thrust_limits(flight), _control(flight).times_s
    return times_s, np.full(len(times_s), np.nan if limits is None else 100.0 * limits[which])


def _cost(flight: Flight) -> Series:
    return flight.chosen_cost


def _candidate(flight: Flight) -> Series:
    return flight.chosen_number


DERIVED: Mapping[str, Derived] = {
    "speed": Derived(unit="m/s", rgb=theme.VEHICLE, read=_speed),
    "target speed": Derived(unit="m/s", rgb=theme.TARGET, read=_target_speed),
    "distance to target": Derived(unit="m", rgb=theme.TARGET, read=_distance),
    "true distance to target": Derived(unit="m", rgb=theme.TRUTH, read=partial(_truth, "target_distance_m")),
    "true clearance": Derived(unit="m", rgb=theme.GOOD, read=partial(_truth, "clearance_m")),
    "clearance by depth": Derived(unit="m", rgb=theme.VEHICLE, read=_clearance),
    "cost flown": Derived(unit="", rgb=theme.GOOD, read=_cost),
    "candidate flown": Derived(unit="", rgb=theme.GOOD, read=_candidate),
    "age of the plan": Derived(unit="ms", rgb=theme.VEHICLE, read=_scaled("plan_age_s", 1e3)),
    "thrust": Derived(unit="%", rgb=theme.VEHICLE, read=_scaled("thrust_norm", 100.0)),
    "hover thrust": Derived(unit="%", rgb=theme.TRUTH, read=_scaled("hover_thrust", 100.0), dashed=True),
    "least thrust": Derived(unit="%", rgb=theme.WARN, read=partial(_thrust_limit, 0), dashed=True),
    "most thrust": Derived(unit="%", rgb=theme.WARN, read=partial(_thrust_limit, 1), dashed=True),
    "tilt": Derived(unit="°", rgb=theme.VEHICLE, read=_tilt),
    "attitude error": Derived(unit="°", rgb=theme.BAD, read=_attitude_error),
    "battery": Derived(unit="%", rgb=theme.GOOD, read=_battery),
    "doubt of the odometry": Derived(unit="of its gate", rgb=theme.WARN, read=_doubt),
    "σ of the target's place": Derived(unit="m", rgb=theme.TARGET, read=_sigma, dashed=True),
    "error of the target's place": Derived(unit="m", rgb=theme.TARGET, read=_target_error),
    **{
        f"{name} {axis}": Derived(unit="m/s²", rgb=rgb, read=partial(_acceleration, field, k))
        for k, axis in enumerate(AXES)
        for name, field, rgb in (
            ("measured acceleration", "acc_meas_world", theme.MEASURED),
            ("desired acceleration", "acc_des_world", theme.GOOD),
            ("commanded acceleration", "acc_att_world", theme.BAD),
            ("disturbance", "acc_disturbance_world", theme.DISTURBANCE),
        )
    },
    **{
        f"velocity {axis}": Derived(unit="m/s", rgb=rgb, read=partial(_along, "vel_world", k))
        for k, (axis, rgb) in enumerate(zip(AXES, (theme.VEHICLE, theme.BAD, theme.GOOD), strict=True))
    },
    **{
        f"true acceleration {axis}": Derived(
            unit="m/s²", rgb=theme.TRUTH, read=partial(_true_acceleration, k), dashed=True
        )
        for k, axis in enumerate(AXES)
    },
    **{
        f"{name}{asked}": Derived(unit="°", rgb=rgb, read=partial(_angle, field, k))
        for k, name in enumerate(ANGLES)
        for asked, field, rgb in (
            ("", "world_from_body", theme.VEHICLE),
            (" asked", "world_from_body_des", theme.GOOD),
        )
    },
    **{
        f"{name} rate{asked}": Derived(unit="°/s", rgb=rgb, read=partial(read, k))
        for k, name in enumerate(ANGLES)
        for asked, rgb, read in (("", theme.VEHICLE, _rate), (" asked", theme.GOOD, _rate_asked))
    },
}
"""By the name that the picker shows."""
