"""Rotations and the camera's place on the vehicle, for exports. Quaternions are (w, x, y, z), unit length."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass

import numpy as np
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.state.decode import MalformedError
from goshawk_dashboards.state.views import Array

WORLD, BODY, CAMERA, OPTICAL = "world", "body", "camera", "camera_optical"
CAMERA_FROM_OPTICAL_4 = np.array([0.5, -0.5, 0.5, -0.5])
"""From image axes (right, down, forward) to FLU."""


def vec(v: pb.Vec3 | pb.Vec3f) -> Array:
    """A message's vector."""
    return np.array((v.x, v.y, v.z))


def quat(q: pb.Quat) -> Array:
    """A message's quaternion."""
    return np.array((q.w, q.x, q.y, q.z))


def rotate_inverse(q_4: Array, v_3: Array) -> Array:
    """``v`` in the frame that ``q`` rotates from."""
    w, xyz_3 = q_4[0], -q_4[1:]
    turned_3: Array = v_3 + 2.0 * np.cross(xyz_3, np.cross(xyz_3, v_3) + w * v_3)  # type: ignore[assignment]
    return turned_3


@dataclass(frozen=True, kw_only=True, eq=False)
class Mount:
    """How the camera sits on the body."""

    pos_body_3: Array
    """Of the lens, m."""
    body_from_camera_4: Array


def camera_mount(header: pb.LogHeader) -> Mount | None:
    """From the vehicle file that the log carries; None if it carries none that says so."""
    try:
        camera = tomllib.loads(header.vehicle_toml)["camera"]
        tilt_rad = math.radians(camera["tilt_deg"])
        # Tilted up: about the left axis, from forward to up, which is its negative sense.
        return Mount(
            pos_body_3=np.array(camera["position_m"], dtype=np.float64).reshape(3),
            body_from_camera_4=np.array([math.cos(tilt_rad / 2), 0.0, -math.sin(tilt_rad / 2), 0.0]),
        )
    except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError, OverflowError, RecursionError):
        return None


@dataclass(frozen=True, kw_only=True)
class Pinhole:
    """An image's intrinsics, pixels; the principal point is in the middle."""

    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def k_9(self) -> list[float]:
        """Row-major 3 x 3."""
        return [self.fx, 0.0, self.cx, 0.0, self.fy, self.cy, 0.0, 0.0, 1.0]

    @property
    def p_12(self) -> list[float]:
        """Row-major 3 x 4."""
        return [self.fx, 0.0, self.cx, 0.0, 0.0, self.fy, self.cy, 0.0, 0.0, 0.0, 1.0, 0.0]


def pinhole(image: pb.CompressedRgbd) -> Pinhole:
    """From an image's size and fields of view. Raises MalformedError if these are none that a camera has."""
    if not (0.0 < image.hfov_rad < math.pi and 0.0 < image.vfov_rad < math.pi):
        raise MalformedError(f"frame that sees {image.hfov_rad} by {image.vfov_rad} rad")
    return Pinhole(
        fx=image.width / 2 / math.tan(image.hfov_rad / 2),
        fy=image.height / 2 / math.tan(image.vfov_rad / 2),
        cx=image.width / 2,
        cy=image.height / 2,
    )


def depth_mm(frame: FrameView) -> bytes | None:
    """Depth as rows of little-endian 16-bit millimetres; None if there is none."""
    depth_HW = frame.depth_m_HW()
    return None if depth_HW is None else np.rint(depth_HW * 1e3).astype("<u2").tobytes()


def matrix(q_4: Array) -> Array:
    """The rotation as a 3 x 3 matrix."""
    w, x, y, z = q_4
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
