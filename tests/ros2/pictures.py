"""A camera's messages: what it sees of a picture, and its lens."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ros_peer import header, new

WIDTH, HEIGHT = 640, 384
FOCAL_PX = 320.0
"""90 degrees wide: the policy's view of 160 x 96, four times as fine."""


def camera_info(stamp_ns: int, part: int = 1, **changes: Any) -> Any:
    """Of the camera, or of one with a part of its pixels each way."""
    width, height, focal_px = WIDTH // part, HEIGHT // part, FOCAL_PX / part
    fields: dict[str, Any] = {
        "header": header(stamp_ns),
        "height": height,
        "width": width,
        "distortion_model": "plumb_bob",
        "d": np.zeros(5),
        "k": np.array([focal_px, 0, (width - 1) / 2, 0, focal_px, (height - 1) / 2, 0, 0, 1.0]),
        "r": np.eye(3).ravel(),
        "p": np.zeros(12),
        "binning_x": 0,
        "binning_y": 0,
        "roi": new("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    }
    return new("sensor_msgs/msg/CameraInfo", **(fields | changes))


def image(stamp_ns: int, encoding: str, pixels: NDArray[Any]) -> Any:
    """Of an array of rows."""
    height, width = pixels.shape[:2]
    data = np.frombuffer(pixels.tobytes(), np.uint8)
    return new(
        "sensor_msgs/msg/Image", header=header(stamp_ns), height=height, width=width, encoding=encoding,
        is_bigendian=0, step=len(data) // height, data=data,
    )  # fmt: skip


def compressed(stamp_ns: int, file_format: str, file: bytes) -> Any:
    data = np.frombuffer(file, np.uint8)
    return new("sensor_msgs/msg/CompressedImage", header=header(stamp_ns), format=file_format, data=data)


Numbers = Sequence[float]


def odometry(stamp_ns: int, pos: Numbers, quaternion_xyzw: Numbers, vel: Numbers, rate: Numbers) -> Any:
    """Velocity and rates in the body's frame."""

    def vector(kind: str, numbers: Numbers) -> Any:
        x, y, z = (float(number) for number in numbers)
        return new(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    x, y, z, w = (float(number) for number in quaternion_xyzw)
    pose = new(
        "geometry_msgs/msg/Pose", position=vector("Point", pos),
        orientation=new("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w),
    )  # fmt: skip
    twist = new("geometry_msgs/msg/Twist", linear=vector("Vector3", vel), angular=vector("Vector3", rate))
    return new(
        "nav_msgs/msg/Odometry", header=header(stamp_ns, "odom"), child_frame_id="base_link",
        pose=new("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
        twist=new("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )  # fmt: skip
