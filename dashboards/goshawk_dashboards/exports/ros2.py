"""For ROS 2 tools: an MCAP file with ROS 2 schemas, as ``ros2 bag`` records, without ROS on this machine.

Frames are REP 103's: ``world`` is ENU, ``body`` FLU; a twist is in its child's frame (REP 105).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from goshawk_proto import goshawk_pb2 as pb
from mcap.writer import Writer

from goshawk_dashboards.exports import frames
from goshawk_dashboards.exports import ros2_messages as ros
from goshawk_dashboards.exports.drawing import plan_lines
from goshawk_dashboards.exports.source import Record
from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.state import decode, words

SAMPLES = 12
"""Points along a trajectory."""

Out = tuple[str, Any]


def write_ros2(records: Iterable[Record], output: Path) -> dict[str, int]:
    """Writes one MCAP file; messages by topic. Raises OSError if it cannot be written."""
    counts: dict[str, int] = {}
    channels: dict[str, int] = {}
    convert = _Messages()
    with output.open("xb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="goshawk")
        schemas: dict[str, int] = {}
        for record in records:
            for topic, message in convert.of(record):
                kind = message.__msgtype__
                if kind not in schemas:
                    definition, _ = ros.STORE.generate_msgdef(kind, ros_version=2)
                    schemas[kind] = writer.register_schema(kind, "ros2msg", definition.encode())
                if topic not in channels:
                    channels[topic] = writer.register_channel(topic, "cdr", schemas[kind])
                data = bytes(ros.STORE.serialize_cdr(message, kind))
                n = counts.get(topic, 0)
                writer.add_message(channels[topic], record.log_ns, data, record.log_ns, sequence=n)
                counts[topic] = n + 1
        writer.finish()
    return counts


class _Messages:
    """Turns the log's messages into ROS 2's."""

    def __init__(self) -> None:
        self._makers: dict[str, Callable[[Any], Iterator[Out]]] = {
            "header": self._header,
            "odometry": self._odometry,
            "control": self._control,
            "imu": self._imu,
            "plan": self._plan,
            "map": self._map,
            "target": self._target,
            "sim_truth": self._truth,
            "rgbd": self._rgbd,
            "event": self._event,
            "health": self._health,
        }

    def of(self, record: Record) -> Iterator[Out]:
        """What one message becomes; one that makes no sense becomes nothing."""
        make = self._makers.get(record.channel)
        if make is None:
            return
        try:
            yield from make(record.message)
        except decode.MalformedError:
            return

    def _header(self, m: pb.LogHeader) -> Iterator[Out]:
        mount = frames.camera_mount(m)
        if mount is not None:
            lens = ros.transform(0, frames.BODY, frames.CAMERA, mount.pos_body_3, mount.body_from_camera_4)
            optical = ros.transform(0, frames.CAMERA, frames.OPTICAL, np.zeros(3), frames.CAMERA_FROM_OPTICAL_4)
            yield "/tf_static", ros.kind_of("tf2_msgs/msg/TFMessage")(transforms=[lens, optical])

    def _odometry(self, m: pb.Odometry) -> Iterator[Out]:
        q_4 = frames.quat(m.world_from_body)
        motion = (frames.rotate_inverse(q_4, frames.vec(m.vel_world)), frames.vec(m.ang_vel_body))
        yield "/odometry", ros.odometry(m.stamp_ns, frames.BODY, frames.vec(m.pos_world), q_4, *motion)

    def _control(self, m: pb.Control) -> Iterator[Out]:
        control = decode.control(m)
        state = ros.transform(
            control.stamp_ns, frames.WORLD, frames.BODY, control.pos_world_3, control.world_from_body_4
        )
        yield "/tf", ros.kind_of("tf2_msgs/msg/TFMessage")(transforms=[state])
        for name, acc_3 in (
            ("desired", control.acc_des_world_3),
            ("attitude", control.acc_att_world_3),
            ("disturbance", control.acc_disturbance_world_3),
            ("measured", control.acc_meas_world_3),
        ):
            if acc_3 is not None:
                yield f"/acceleration/{name}", ros.acceleration(control.stamp_ns, acc_3)
        if m.HasField("world_from_body_des"):
            yield (
                "/setpoint/attitude",
                ros.kind_of("geometry_msgs/msg/QuaternionStamped")(
                    header=ros.header(control.stamp_ns, frames.WORLD),
                    quaternion=ros.quaternion(frames.quat(m.world_from_body_des)),
                ),
            )
        yield "/setpoint/thrust", ros.kind_of("std_msgs/msg/Float64")(data=control.thrust_norm)

    def _imu(self, m: pb.Imu) -> Iterator[Out]:
        unknown_9 = np.zeros(9)
        unknown_9[0] = -1.0
        yield (
            "/imu",
            ros.kind_of("sensor_msgs/msg/Imu")(
                header=ros.header(m.stamp_ns, frames.BODY),
                orientation=ros.quaternion(ros.IDENTITY_4),
                orientation_covariance=unknown_9,
                angular_velocity=ros.vector(frames.vec(m.ang_vel_body)),
                angular_velocity_covariance=np.zeros(9),
                linear_acceleration=ros.vector(frames.vec(m.specific_force_body)),
                linear_acceleration_covariance=np.zeros(9),
            ),
        )

    def _map(self, m: pb.ObstacleMap) -> Iterator[Out]:
        remembered = decode.remembered(m)
        points_V3 = (remembered.origin_world_3 + remembered.centre_V3).astype("<f4")
        field = ros.kind_of("sensor_msgs/msg/PointField")
        fields = [
            field(name=axis, offset=4 * k, datatype=field.FLOAT32, count=1) for k, axis in enumerate(("x", "y", "z"))
        ]
        yield (
            "/remembered",
            ros.kind_of("sensor_msgs/msg/PointCloud2")(
                header=ros.header(m.stamp_ns, frames.WORLD),
                height=1,
                width=len(points_V3),
                fields=fields,
                is_bigendian=False,
                point_step=12,
                row_step=12 * len(points_V3),
                data=np.frombuffer(points_V3.tobytes(), dtype=np.uint8),
                is_dense=True,
            ),
        )

    def _plan(self, m: pb.Plan) -> Iterator[Out]:
        plan = decode.plan(m)
        lines = plan_lines(plan, SAMPLES)
        header = ros.header(plan.ready_ns, frames.WORLD)
        markers = [
            ros.line(header, k, points_S3, rgb, width_m=0.02)
            for k, (points_S3, rgb) in enumerate(zip(lines.points_NS3, lines.rgb_N3, strict=True))
        ]
        yield "/plan/candidates", ros.kind_of("visualization_msgs/msg/MarkerArray")(markers=markers)
        if lines.chosen is not None:
            times_S = np.linspace(0.0, plan.duration_s, SAMPLES)
            poses = [
                ros.kind_of("geometry_msgs/msg/PoseStamped")(
                    header=ros.header(plan.frame_ns + int(t * 1e9), frames.WORLD), pose=ros.pose(p_3)
                )
                for t, p_3 in zip(times_S, lines.points_NS3[lines.chosen], strict=True)
            ]
            yield "/plan/chosen", ros.kind_of("nav_msgs/msg/Path")(header=header, poses=poses)

    def _target(self, m: pb.Target) -> Iterator[Out]:
        target = decode.target(m)
        message = ros.odometry(m.stamp_ns, "target", target.pos_world_3, ros.IDENTITY_4, target.vel_world_3)
        if target.covariance_66 is not None:
            pose_66, twist_66 = np.zeros((6, 6)), np.zeros((6, 6))
            pose_66[:3, :3], twist_66[:3, :3] = target.covariance_66[:3, :3], target.covariance_66[3:, 3:]
            message.pose.covariance, message.twist.covariance = pose_66.ravel(), twist_66.ravel()
        yield "/target/estimate", message

    def _truth(self, m: pb.SimTruth) -> Iterator[Out]:
        q_4 = frames.quat(m.world_from_body)
        vel_body_3 = frames.rotate_inverse(q_4, frames.vec(m.vel_world))
        yield "/truth/odometry", ros.odometry(m.stamp_ns, "true_body", frames.vec(m.pos_world), q_4, vel_body_3)
        if m.HasField("acc_world"):
            yield "/acceleration/true", ros.acceleration(m.stamp_ns, frames.vec(m.acc_world))
        yield "/truth/clearance", ros.kind_of("std_msgs/msg/Float64")(data=m.clearance_m)
        if m.HasField("target_pos_world"):
            pos_3, vel_3 = frames.vec(m.target_pos_world), frames.vec(m.target_vel_world)
            yield "/truth/target", ros.odometry(m.stamp_ns, "true_target", pos_3, ros.IDENTITY_4, vel_3)

    def _rgbd(self, m: pb.CompressedRgbd) -> Iterator[Out]:
        frame = FrameView.of(m)
        header = ros.header(m.stamp_ns, frames.OPTICAL)
        colour = np.frombuffer(m.rgb_png, dtype=np.uint8)
        yield (
            "/camera/image/compressed",
            ros.kind_of("sensor_msgs/msg/CompressedImage")(
                header=header, format="rgb8; png compressed bgr8", data=colour
            ),
        )
        depth = frames.depth_mm(frame)
        if depth is not None:
            yield (
                "/camera/depth/image",
                ros.kind_of("sensor_msgs/msg/Image")(
                    header=header,
                    height=m.height,
                    width=m.width,
                    encoding="16UC1",
                    is_bigendian=0,
                    step=2 * m.width,
                    data=np.frombuffer(depth, dtype=np.uint8),
                ),
            )
        yield "/camera/camera_info", ros.camera_info(header, m)

    def _event(self, m: pb.Event) -> Iterator[Out]:
        log = ros.kind_of("rcl_interfaces/msg/Log")
        event = decode.event(m)
        level = {pb.SEVERITY_WARNING: log.WARN, pb.SEVERITY_ERROR: log.ERROR}.get(event.severity, log.INFO)
        yield (
            "/rosout",
            log(
                stamp=ros.stamp(m.stamp_ns), level=level, name=event.kind, msg=event.text, file="", function="", line=0
            ),
        )

    def _health(self, m: pb.Health) -> Iterator[Out]:
        kind, pair = ros.kind_of("diagnostic_msgs/msg/DiagnosticStatus"), ros.kind_of("diagnostic_msgs/msg/KeyValue")
        figures = [pair(key=f"{r.name}_hz", value=f"{r.hz:.2f}") for r in m.rates]
        figures += [pair(key=f"{x.name}_p99_ms", value=f"{x.p99_ms:.3f}") for x in m.latencies]
        state = kind(
            level=kind.OK if m.ready else kind.WARN,
            name="goshawk",
            message=words.mode(m.mode),
            hardware_id=m.vehicle,
            values=figures,
        )
        checks = [
            kind(
                level=kind.OK if c.ok else kind.ERROR,
                name=f"goshawk/{c.name}",
                message=c.reason,
                hardware_id=m.vehicle,
                values=[],
            )
            for c in m.checks
        ]
        header = ros.header(m.stamp_ns, "")
        yield "/diagnostics", ros.kind_of("diagnostic_msgs/msg/DiagnosticArray")(header=header, status=[state, *checks])
