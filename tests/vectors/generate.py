"""Golden vectors for the core's mathematics: an independent float64 implementation, written from the paper's equations.

Where the flight code uses a closed form, this uses the definition (linear solves, 4 x 4 transforms, full 6 x 6 filters,
matrix exponentials of augmented systems), so that an error in one is not repeated in the other.

    python tests/vectors/generate.py [DIRECTORY]    writes *.json, by default beside this file

`preprocess.json` beside them is written by the training side.

Shape suffixes: B case, N anchor (row-major from the image's top left), C channel, K sample, 3 x y z,
Q quaternion w x y z.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Json = dict[str, object]

GRAVITY = 9.80665
ROWS, COLUMNS = 3, 5
ANCHORS = ROWS * COLUMNS
MAX_ACC = 8.0
CHANNELS = 14


@dataclass(frozen=True, kw_only=True)
class Policy:
    """What the policy's contract says; radians, metres, seconds."""

    hfov: float = float(np.deg2rad(90.0))
    vfov: float = float(2.0 * np.arctan(48.0 / 80.0))
    width: int = 160
    height: int = 96
    radius: float = 5.0
    azimuth_offset: float = float(np.deg2rad(15.0))
    elevation_offset: float = float(np.deg2rad(15.0))
    v_max: float = 6.0
    a_max: float = 6.0
    target_depth_scale: float = 5.0


# ---- rotations, from their definitions ----


def axis_rotation(axis: str, angle: float) -> Array:
    """Right-handed rotation matrix about one axis."""
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis].astype(np.float64)


def quaternion(matrix: Array) -> Array:
    """(w, x, y, z) with w >= 0: the eigenvector of Bar-Itzhack's symmetric matrix with the largest eigenvalue."""
    m = matrix
    k = np.array(
        [
            [m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
            [m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
            [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m[0, 0] + m[1, 1] + m[2, 2]],
        ]
    )
    _, vectors = np.linalg.eigh(k)
    x, y, z, w = vectors[:, -1]
    q = np.array([w, x, y, z])
    return q if w >= 0 else -q


def random_rotation(rng: np.random.Generator, tilt: float = 0.6) -> Array:
    """Any heading, roll and pitch up to `tilt`."""
    yaw, pitch, roll = rng.uniform(-np.pi, np.pi), rng.uniform(-tilt, tilt), rng.uniform(-tilt, tilt)
    return axis_rotation("z", yaw) @ axis_rotation("y", pitch) @ axis_rotation("x", roll)


# ---- eq. 3: the lattice ----


def cell_angles(policy: Policy, index: int) -> tuple[float, float]:
    """(elevation, azimuth) of a cell's centre: equal angles over the fields of view, positive up and left."""
    row, column = divmod(index, COLUMNS)
    azimuths = np.linspace(policy.hfov / 2, -policy.hfov / 2, 2 * COLUMNS + 1)[1::2]
    elevations = np.linspace(policy.vfov / 2, -policy.vfov / 2, 2 * ROWS + 1)[1::2]
    return float(elevations[row]), float(azimuths[column])


def spherical(radius: float, elevation: float, azimuth: float) -> Array:
    """eq. 3 and 4."""
    return radius * np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )


def cam_from_cell(elevation: float, azimuth: float) -> Array:
    """The cell's axes as columns: along the anchor, level to its left, and the third."""
    ahead = spherical(1.0, elevation, azimuth)
    left = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return np.column_stack([ahead, left, np.cross(ahead, left)])


def lattice() -> Json:
    policy = Policy()
    anchors: list[Json] = []
    for index in range(ANCHORS):
        elevation, azimuth = cell_angles(policy, index)
        anchors.append(
            {
                "elevation": elevation,
                "azimuth": azimuth,
                "primitive_3": spherical(policy.radius, elevation, azimuth).tolist(),
                "cam_from_cell_Q": quaternion(cam_from_cell(elevation, azimuth)).tolist(),
            }
        )
    return {"hfov": policy.hfov, "vfov": policy.vfov, "radius": policy.radius, "anchors_N": anchors}


# ---- eq. 1-2: the quintic ----


def derivative_row(t: float, order: int) -> Array:
    """d^order/dt^order of [1, t, ..., t^5]."""
    row = np.zeros(6)
    for k in range(order, 6):
        factor = np.prod(np.arange(k, k - order, -1)) if order else 1.0
        row[k] = factor * t ** (k - order)
    return row


def quintic_coefficients(start_33: Array, end_33: Array, duration: float) -> Array:
    """[6, 3] coefficients: the inverse of the boundary matrix, M of eq. 2. Rows of the states: f, f', f''."""
    boundary = np.array([derivative_row(t, order) for t in (0.0, duration) for order in range(3)])
    return np.asarray(np.linalg.solve(boundary, np.vstack([start_33, end_33])), dtype=np.float64)


def quintic() -> Json:
    rng = np.random.default_rng(2)
    cases: list[Json] = []
    for duration in (0.4, 1.0, 10.0 / 6.0, 3.3):
        start_33 = rng.normal(size=(3, 3)) * [[5], [4], [3]]
        end_33 = rng.normal(size=(3, 3)) * [[5], [4], [3]]
        coefficients = quintic_coefficients(start_33, end_33, duration)
        samples: list[Json] = []
        for t in np.linspace(0.0, duration, 7):
            pos, vel, acc, jerk = (derivative_row(float(t), order) @ coefficients for order in range(4))
            samples.append(
                {"t": float(t), "pos": pos.tolist(), "vel": vel.tolist(), "acc": acc.tolist(), "jerk": jerk.tolist()}
            )
        cases.append(
            {"start_33": start_33.tolist(), "end_33": end_33.tolist(), "duration": duration, "samples_K": samples}
        )
    return {"cases_B": cases}


# ---- eq. 4-9: decoding, in the world frame ----


def camera_matrix(policy: Policy) -> Array:
    """C of eq. 9; u right, v down, z along the optical axis."""
    fx = policy.width / 2 / np.tan(policy.hfov / 2)
    fy = policy.height / 2 / np.tan(policy.vfov / 2)
    return np.array([[fx, 0, policy.width / 2], [0, fy, policy.height / 2], [0, 0, 1.0]])


# Camera FLU from the optical frame (x right, y down, z forward).
FLU_FROM_OPTICAL = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], dtype=np.float64)


def transform(rotation: Array, translation: Array) -> Array:
    """4 x 4 homogeneous transform."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, translation
    return out


def decode_anchor(policy: Policy, y_C: Array, index: int, alpha: float, start_3: Array, world_from_cam: Array) -> Json:
    """eq. 4, 6-9 for one anchor. `world_from_cam` is 4 x 4 at the lens; trajectories start at `start_3`."""
    elevation, azimuth = cell_angles(policy, index)
    bounded = np.tanh(y_C[:9])
    end_cam = spherical(
        policy.radius + bounded[2] * policy.radius,
        elevation + bounded[0] * policy.elevation_offset,
        azimuth + bounded[1] * policy.azimuth_offset,
    )
    rotation = world_from_cam[:3, :3]
    cell = cam_from_cell(elevation, azimuth)
    vel = rotation @ cell @ bounded[3:6] * alpha * policy.v_max
    acc = rotation @ cell @ bounded[6:9] * alpha**2 * policy.a_max
    sigma = 1.0 / (1.0 + np.exp(-y_C[10:13]))
    softplus = np.logaddexp(0.0, y_C[[9, 13]])
    row, column = divmod(index, COLUMNS)
    stride = policy.width // COLUMNS
    pixel = np.array([(2 * sigma[1] - 0.5 + column) * stride, (2 * sigma[2] - 0.5 + row) * stride, 1.0])
    optical = np.linalg.inv(camera_matrix(policy)) @ pixel * (policy.target_depth_scale * softplus[1])
    target = world_from_cam @ np.append(FLU_FROM_OPTICAL @ optical, 1.0)
    return {
        "end_pos": (start_3 + rotation @ end_cam).tolist(),
        "end_vel": vel.tolist(),
        "end_acc": acc.tolist(),
        "cost": float(softplus[0]),
        "objectness": float(sigma[0]),
        "target": target[:3].tolist(),
    }


def decode() -> Json:
    policy, rng = Policy(), np.random.default_rng(3)
    cases: list[Json] = []
    for speed, tilt, far in ((6.0, 0.0, 30.0), (9.0, 0.35, 30.0), (3.0, 0.1745, 3.0), (15.0, -0.2, 30.0)):
        body = random_rotation(rng)
        pos, lens = rng.normal(size=3) * 5, np.array([0.07, 0.01, 0.03])
        vel, acc, goal = rng.normal(size=3) * 2, rng.normal(size=3) * 2, rng.normal(size=3) * far
        body_from_cam = axis_rotation("y", -tilt)
        world_from_cam = transform(body, pos) @ transform(body_from_cam, lens)
        alpha = speed / policy.v_max
        raw_CN = rng.normal(size=(CHANNELS, ANCHORS)).astype(np.float32).astype(np.float64) * 1.5
        raw_CN = raw_CN.astype(np.float32).astype(np.float64)
        cam_from_world = np.linalg.inv(world_from_cam)[:3, :3]
        aim = (goal - pos) / max(2 * policy.radius, float(np.linalg.norm(goal - pos)))
        agility = min(1.0, MAX_ACC / (alpha**2 * policy.a_max))
        state = [vel / (alpha * policy.v_max), acc / (alpha**2 * policy.a_max), np.array([0, 0, 1.0]), aim]
        cases.append(
            {
                "speed": speed,
                "tilt": tilt,
                "lens_body_3": lens.tolist(),
                "pos_3": pos.tolist(),
                "vel_3": vel.tolist(),
                "acc_3": acc.tolist(),
                "goal_3": goal.tolist(),
                "world_from_body_Q": quaternion(body).tolist(),
                "raw_CN": raw_CN.tolist(),
                "duration": 2 * policy.radius / (alpha * policy.v_max),
                "state": [*np.concatenate([cam_from_world @ v for v in state]).tolist(), agility],
                "world_from_cam_Q": quaternion(world_from_cam[:3, :3]).tolist(),
                "candidates_N": [
                    decode_anchor(policy, raw_CN[:, n], n, alpha, pos, world_from_cam) for n in range(ANCHORS)
                ],
            }
        )
    return {"policy": vars(policy), "cases_B": cases}


# ---- eq. 10: the target filter, as one 6 x 6 filter ----


@dataclass(frozen=True, kw_only=True)
class Filter:
    """The target filter's settings; SI."""

    acc_variance: tuple[float, float, float] = (48.0, 48.0, 24.0)
    lateral_variance: float = 0.015
    range_variance: float = 0.06
    doubt: float = 16.0
    variance_distance: float = 6.0
    gate: float = 5.0
    confirm_hits: int = 4
    confirm_of: int = 6
    max_speed: float = 10.0
    outlier: float = 2.0


def target() -> Json:
    """A target seen at irregular frames: some with a second detection of it, some with a false one, some blank."""
    config, rng = Filter(), np.random.default_rng(4)
    lens = np.array([1.0, -2.0, 1.5])
    x: Array = np.zeros(6)
    covariance: Array = np.eye(6)
    history: list[bool] = []
    confirmed = False
    now_ns, frames = 10_000_000_000, []
    truth, velocity = np.array([6.0, 0.0, 1.0]), np.array([3.0, 1.5, 0.0])
    for k in range(60):
        step_ns = int(rng.choice([16_666_667, 33_333_333, 50_000_000]))
        now_ns += step_ns
        dt = step_ns * 1e-9
        velocity = velocity + rng.normal(size=3) * np.array([0.4, 0.4, 0.05])
        truth = truth + velocity * dt
        blank = k in (7, 8, 20, 21, 22, 23, 41)
        detections = [] if blank else [truth + rng.normal(size=3) * 0.1]
        if k % 11 == 6:
            detections = [truth + np.array([1.2, 0.0, 0.0])]
        if k % 7 == 3:
            detections.append(truth + rng.normal(size=3) * 0.25)
        if k % 5 == 4:
            detections.append(truth + np.array([0.0, 9.0, 0.5]))
        objectness = rng.uniform(0.5, 1.0, len(detections)).tolist()
        if k == 0:
            x = np.concatenate([detections[0], np.zeros(3)])
            covariance = np.diag([0.0] * 3 + [(config.max_speed / 2) ** 2] * 3)
            covariance[:3, :3] = measurement_covariance(config, detections[0] - lens, objectness[0])
            history, consistent = [True], [False] * len(detections)
        else:
            transition = np.block([[np.eye(3), dt * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
            push = np.vstack([0.5 * dt**2 * np.eye(3), dt * np.eye(3)])
            x = transition @ x
            covariance = transition @ covariance @ transition.T + push @ np.diag(config.acc_variance) @ push.T
            measure = np.hstack([np.eye(3), np.zeros((3, 3))])
            corrections: list[tuple[bool, float, Array, Array]] = []
            for detection, sure in zip(detections, objectness, strict=True):
                innovation, prior = detection - measure @ x, measure @ covariance @ measure.T
                spread = prior + measurement_covariance(config, detection - lens, 1.0)
                size = float(np.sqrt(innovation @ np.linalg.solve(spread, innovation)))
                noise = measurement_covariance(config, detection - lens, sure)
                wrong = float(np.sqrt(innovation @ np.linalg.solve(prior + noise, innovation))) / config.outlier
                noise = noise * max(1.0, wrong) ** 2
                gain = covariance @ measure.T @ np.linalg.inv(prior + noise)
                corrections.append((size <= config.gate, sure, gain, innovation))
            inside = [near for near, _, _, _ in corrections]
            if any(inside):
                _, _, gain, innovation = max(corrections, key=lambda c: c[:2])
                x = x + gain @ innovation
                covariance = (np.eye(6) - gain @ measure) @ covariance
                speed = float(np.linalg.norm(x[3:]))
                x[3:] *= min(1.0, config.max_speed / speed) if speed > 0 else 1.0
            history.append(any(inside))
            confirmed = confirmed or sum(history[-config.confirm_of :]) >= config.confirm_hits
            consistent = [c and confirmed for c in inside]
        frames.append(
            {
                "stamp_ns": now_ns,
                "detections": [d.tolist() for d in detections],
                "objectness": objectness,
                "consistent": consistent,
                "confirmed": confirmed,
                "pos": x[:3].tolist(),
                "vel": x[3:].tolist(),
                "covariance": covariance.tolist(),
            }
        )
    return {"filter": vars(config), "lens_3": lens.tolist(), "frames_K": frames}


def measurement_covariance(config: Filter, sight_3: Array, objectness: float) -> Array:
    """In a frame whose first axis is the line of sight it is diagonal; both variances double at `variance_distance`."""
    frame = np.linalg.svd(sight_3[None])[2]  # rows: the line of sight, and two axes across it
    larger = (1.0 + float(sight_3 @ sight_3) / config.variance_distance**2) * (
        1.0 + config.doubt * float(np.sqrt(1.0 - objectness))
    )
    variances = [config.range_variance, config.lateral_variance, config.lateral_variance]
    return larger * frame.T @ np.diag(variances) @ frame


# ---- eq. 14-15: the observer, by the exponential of the whole augmented system ----


def matrix_exponential(a: Array) -> Array:
    """Scaling and squaring of the Taylor series."""
    squarings = max(0, int(np.ceil(np.log2(max(float(np.abs(a).sum(axis=1).max()), 1e-16)))) + 6)
    scaled, term, out = a / 2.0**squarings, np.eye(len(a)), np.eye(len(a))
    for k in range(1, 20):
        term = term @ scaled / k
        out = out + term
    for _ in range(squarings):
        out = out @ out
    return out


def observer() -> Json:
    """Velocity linear and model constant between samples; states z1, z2, v, v', u of one axis, per unit mass."""
    rng = np.random.default_rng(5)
    cases: list[Json] = []
    for alpha1, alpha2, zeta in ((3.0, 2.0, 0.2), (2.0, 1.0, 0.1), (1.0, 4.0, 0.3)):
        a, b = alpha1 / zeta, alpha2 / zeta**2
        v = rng.normal(size=3)
        z1, z2 = v.copy(), np.zeros(3)
        steps: list[Json] = [{"dt": 0.01, "vel": v.tolist(), "model": [0.0, 0.0, 0.0], "disturbance": z2.tolist()}]
        for k in range(40):
            dt = float(rng.choice([0.002, 0.01, 0.033, 0.15]))
            model = rng.normal(size=3) * 2
            push = np.array([0.5, -0.3, 0.8]) * (1 + k / 20)
            v_next = v + (model + push + rng.normal(size=3) * 0.3) * dt
            system = np.array(
                [
                    [-a, 1, a, 0, 1],
                    [-b, 0, b, 0, 0],
                    [0, 0, 0, 1, 0],
                    [0, 0, 0, 0, 0],
                    [0, 0, 0, 0, 0],
                ],
                dtype=np.float64,
            )
            end = matrix_exponential(system * dt) @ np.stack([z1, z2, v, (v_next - v) / dt, model])
            z1, z2, v = end[0], end[1], v_next
            steps.append({"dt": dt, "vel": v.tolist(), "model": model.tolist(), "disturbance": z2.tolist()})
        cases.append({"alpha1": alpha1, "alpha2": alpha2, "zeta": zeta, "steps_K": steps})
    return {"cases_B": cases}


# ---- eq. 11-13: flatness, and the lead ----


@dataclass(frozen=True, kw_only=True)
class Vehicle:
    """Mass (kg), normalised thrusts, tilt (rad)."""

    mass: float = 0.85
    hover_thrust: float = 0.25
    min_thrust: float = 0.03
    max_thrust: float = 0.9
    max_tilt: float = float(np.deg2rad(45.0))


def flatness() -> Json:
    vehicle, rng = Vehicle(), np.random.default_rng(6)
    per_thrust = GRAVITY / vehicle.hover_thrust
    accelerations = [rng.normal(size=3) * scale for scale in (1, 1, 3, 3, 8, 8, 30, 30)]
    accelerations += [np.array([0, 0, -30.0]), np.array([50.0, 0, 0]), np.array([20.0, -20.0, 60.0]), np.zeros(3)]
    cases: list[Json] = []
    for k, acc in enumerate(accelerations):
        push = rng.normal(size=3) * 0.7
        yaw = float(rng.uniform(-np.pi, np.pi)) if k % 3 else [0.0, np.pi / 2, -np.pi / 2, np.pi][k // 3]
        force = acc - push + np.array([0, 0, GRAVITY])
        vertical = min(max(force[2], vehicle.min_thrust * per_thrust), vehicle.max_thrust * per_thrust)
        horizontal = float(np.hypot(force[0], force[1]))
        by_tilt = vertical * np.tan(vehicle.max_tilt)
        by_thrust = np.sqrt(max((vehicle.max_thrust * per_thrust) ** 2 - vertical**2, 0.0))
        shrink = min(1.0, by_tilt / horizontal, by_thrust / horizontal) if horizontal > 0 else 1.0
        force = np.array([force[0] * shrink, force[1] * shrink, vertical])
        r_z = force / np.linalg.norm(force)
        cross = np.cross(r_z, [np.cos(yaw), np.sin(yaw), 0.0])
        r_y = cross / np.linalg.norm(cross)
        r_x = np.cross(r_y, r_z)
        newtons = vehicle.mass * float(np.linalg.norm(force))
        cases.append(
            {
                "acc_3": acc.tolist(),
                "disturbance_3": push.tolist(),
                "yaw": yaw,
                "world_from_body_Q": quaternion(np.column_stack([r_x, r_y, r_z])).tolist(),
                "force_n": newtons,
                "thrust": newtons / (vehicle.mass * GRAVITY) * vehicle.hover_thrust,
                "acc_att_3": (force - np.array([0, 0, GRAVITY])).tolist(),
            }
        )
    return {"vehicle": vars(vehicle), "cases_B": cases}


def lead() -> Json:
    rng = np.random.default_rng(7)
    tau, limit = 0.12, 4.0
    cases: list[Json] = []
    for scale in (1.0, 10.0, 30.0, 100.0):
        acc, jerk = rng.normal(size=3) * 4, rng.normal(size=3) * scale
        ahead = tau * jerk
        ahead = ahead * min(1.0, limit / float(np.linalg.norm(ahead)))
        cases.append({"acc_3": acc.tolist(), "jerk_3": jerk.tolist(), "led_3": (acc + ahead).tolist()})
    return {"tau": tau, "limit": limit, "cases_B": cases}


GENERATORS: dict[str, Callable[[], Json]] = {
    "lattice": lattice,
    "quintic": quintic,
    "decode": decode,
    "target": target,
    "observer": observer,
    "flatness": flatness,
    "lead": lead,
}


def text(vectors: Json) -> str:
    """JSON with one line for each case, so that a change shows where it is."""
    lines: list[str] = []
    for key, value in vectors.items():
        body = json.dumps(value)
        items = cast("list[object]", value) if isinstance(value, list) else []
        if items and isinstance(items[0], dict):
            body = "[\n  " + ",\n  ".join(json.dumps(item) for item in items) + "\n ]"
        lines.append(f" {json.dumps(key)}: {body}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def main() -> None:
    directory = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for name, generator in GENERATORS.items():
        (directory / f"{name}.json").write_text(text(generator()))


if __name__ == "__main__":
    main()
