"""ROS 2's messages from plain values, without ROS on this machine. Quaternions are (w, x, y, z)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from rosbags.typesys import Stores, get_typestore

from goshawk_dashboards.exports import frames
from goshawk_dashboards.exports.drawing import LIFETIME_S
from goshawk_dashboards.state.decode import MalformedError
from goshawk_dashboards.state.views import Array

STORE = get_typestore(Stores.ROS2_JAZZY)
"""Definitions and serialisation of every message."""
_TYPES: dict[str, Any] = dict(STORE.types)

IDENTITY_4 = np.array([1.0, 0.0, 0.0, 0.0])


@cache
def kind_of(name: str) -> Any:
    """The class of a message by its ROS name."""
    return _TYPES[name]


def stamp(stamp_ns: int) -> Any:
    """A time on the vehicle's clock. Raises MalformedError for one after 68 years, which ROS 2 cannot tell."""
    if stamp_ns >= 2**31 * 10**9:
        raise MalformedError(f"stamp of {stamp_ns} ns")
    return kind_of("builtin_interfaces/msg/Time")(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)


def header(stamp_ns: int, frame: str) -> Any:
    """Time and frame."""
    return kind_of("std_msgs/msg/Header")(stamp=stamp(stamp_ns), frame_id=frame)


def vector(v_3: Array) -> Any:
    """A Vector3."""
    x, y, z = v_3.tolist()
    return kind_of("geometry_msgs/msg/Vector3")(x=x, y=y, z=z)


def point(p_3: Array) -> Any:
    """A Point."""
    x, y, z = p_3.tolist()
    return kind_of("geometry_msgs/msg/Point")(x=x, y=y, z=z)


def quaternion(q_4: Array) -> Any:
    """A Quaternion of (w, x, y, z)."""
    w, x, y, z = q_4.tolist()
    return kind_of("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w)


def pose(pos_3: Array, q_4: Array = IDENTITY_4) -> Any:
    """A Pose."""
    return kind_of("geometry_msgs/msg/Pose")(position=point(pos_3), orientation=quaternion(q_4))


def transform(stamp_ns: int, parent: str, child: str, pos_3: Array, q_4: Array) -> Any:
    """Where a child frame is in its parent."""
    return kind_of("geometry_msgs/msg/TransformStamped")(
        header=header(stamp_ns, parent),
        child_frame_id=child,
        transform=kind_of("geometry_msgs/msg/Transform")(translation=vector(pos_3), rotation=quaternion(q_4)),
    )


def acceleration(stamp_ns: int, acc_3: Array) -> Any:
    """An AccelStamped in the world frame."""
    accel = kind_of("geometry_msgs/msg/Accel")(linear=vector(acc_3), angular=vector(np.zeros(3)))
    return kind_of("geometry_msgs/msg/AccelStamped")(header=header(stamp_ns, frames.WORLD), accel=accel)


def odometry(
    stamp_ns: int, child: str, pos_3: Array, q_4: Array, vel_child_3: Array, ang_vel_child_3: Array | None = None
) -> Any:
    """An Odometry in the world frame; its twist is in the child's."""
    twist = kind_of("geometry_msgs/msg/Twist")(
        linear=vector(vel_child_3), angular=vector(np.zeros(3) if ang_vel_child_3 is None else ang_vel_child_3)
    )
    return kind_of("nav_msgs/msg/Odometry")(
        header=header(stamp_ns, frames.WORLD),
        child_frame_id=child,
        pose=kind_of("geometry_msgs/msg/PoseWithCovariance")(pose=pose(pos_3, q_4), covariance=np.zeros(36)),
        twist=kind_of("geometry_msgs/msg/TwistWithCovariance")(twist=twist, covariance=np.zeros(36)),
    )


def camera_info(header: Any, m: pb.CompressedRgbd) -> Any:
    """An image's intrinsics."""
    lens = frames.pinhole(m)
    roi = kind_of("sensor_msgs/msg/RegionOfInterest")(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return kind_of("sensor_msgs/msg/CameraInfo")(
        header=header,
        height=m.height,
        width=m.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array(lens.k_9),
        r=np.eye(3).ravel(),
        p=np.array(lens.p_12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


def line(header: Any, number: int, points_S3: Array, rgb: np.ndarray, *, width_m: float) -> Any:
    """A Marker: a line through points."""
    kind = kind_of("visualization_msgs/msg/Marker")
    red, green, blue = (rgb / 255.0).tolist()
    empty = kind_of("sensor_msgs/msg/CompressedImage")(header=header, format="", data=np.zeros(0, dtype=np.uint8))
    return kind(
        header=header,
        ns="candidates",
        id=number,
        type=kind.LINE_STRIP,
        action=kind.ADD,
        pose=pose(np.zeros(3)),
        scale=vector(np.array([width_m, 0.0, 0.0])),
        color=kind_of("std_msgs/msg/ColorRGBA")(r=red, g=green, b=blue, a=1.0),
        lifetime=kind_of("builtin_interfaces/msg/Duration")(sec=0, nanosec=int(LIFETIME_S * 1e9)),
        frame_locked=False,
        points=[point(p_3) for p_3 in points_S3],
        colors=[],
        texture_resource="",
        texture=empty,
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=kind_of("visualization_msgs/msg/MeshFile")(filename="", data=np.zeros(0, dtype=np.uint8)),
        mesh_use_embedded_materials=False,
    )
