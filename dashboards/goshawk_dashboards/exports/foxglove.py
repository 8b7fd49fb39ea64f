"""For Foxglove and Lichtblick: the log's own channels, and what their 3-D, image and log panels read.

The log's channels are copied under their topic with a leading slash, which old message paths need; ``TOPICS`` are
added. The layout that shows them is ``foxglove-layout.json`` beside this file.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.duration_pb2 import Duration
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from goshawk_proto import goshawk_pb2 as pb
from mcap_protobuf.writer import Writer

from goshawk_dashboards.exports import frames
from goshawk_dashboards.exports.drawing import LIFETIME_S, FlownPath, plan_lines
from goshawk_dashboards.exports.source import Record
from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.page import theme
from goshawk_dashboards.state import decode
from goshawk_dashboards.state.views import Array

SAMPLES = 16
"""Points along a drawn trajectory."""
PERSON_M = (0.5, 0.5, 1.75)

Out = tuple[str, Message]

TOPICS: Mapping[str, type[Message]] = {
    "/tf": FrameTransform,
    "/tf_static": FrameTransforms,
    "/vehicle/pose": PoseInFrame,
    "/camera/image": CompressedImage,
    "/camera/depth": RawImage,
    "/camera/calibration": CameraCalibration,
    **{f"/scene/{what}": SceneUpdate for what in ("vehicle", "plan", "target", "truth", "path")},
    "/remembered": PointCloud,
    "/log": Log,
}
"""What is added to our own channels, with Foxglove's schemas."""


def write_foxglove(records: Iterable[Record], output: Path) -> dict[str, int]:
    """Writes one MCAP file; messages by topic. Raises OSError if it cannot be written."""
    counts: dict[str, int] = {}
    scene = Scene()
    with output.open("xb") as file, Writer(file) as writer:

        def put(topic: str, message: Message, log_ns: int) -> None:
            writer.write_message(topic, message, log_time=log_ns, publish_time=log_ns, sequence=counts.get(topic, 0))
            counts[topic] = counts.get(topic, 0) + 1

        first_ns: int | None = None
        for record in records:
            first_ns = min(first_ns or record.log_ns, record.log_ns)
            put(f"/{record.topic}", record.message, record.log_ns)
            for topic, message in scene.of(record):
                put(topic, message, record.log_ns)
        # What stands for the whole flight is stamped with its beginning, so that it is there wherever one looks.
        for topic, message in scene.standing(first_ns or 0):
            put(topic, message, first_ns or 0)
    return counts


class Scene:
    """Turns our messages into Foxglove's."""

    def __init__(self, path_points: int | None = None) -> None:
        """``path_points``: how much of the flown path is kept; None: all."""
        self._path = FlownPath(path_points)
        self._mount: frames.Mount | None = None
        self._makers: dict[str, Callable[[Any], Iterator[Out]]] = {
            "header": self._header,
            "control": self._control,
            "plan": self._plan,
            "map": self._map,
            "target": self._target,
            "sim_truth": self._truth,
            "rgbd": self._rgbd,
            "preview": self._preview,
            "event": self._event,
        }

    def of(self, record: Record) -> Iterator[Out]:
        """What one message adds; one that makes no sense adds nothing."""
        make = self._makers.get(record.channel)
        if make is None:
            return
        try:
            yield from make(record.message)
        except decode.MalformedError:
            return

    def standing(self, first_ns: int) -> Iterator[Out]:
        """The vehicle's body, the flown path, the camera's place."""
        yield "/scene/vehicle", SceneUpdate(entities=[_vehicle(first_ns)])
        if self._mount is not None:
            optical_4 = frames.CAMERA_FROM_OPTICAL_4
            mount = self._mount
            lens = _transform(first_ns, frames.BODY, frames.CAMERA, mount.pos_body_3, mount.body_from_camera_4)
            optical = _transform(first_ns, frames.CAMERA, frames.OPTICAL, np.zeros(3), optical_4)
            yield "/tf_static", FrameTransforms(transforms=[lens, optical])
        line = _line(self._path.points_P3, width=2.0)
        line.colors.extend(_color(rgb) for rgb in self._path.rgb_P3)
        yield "/scene/path", SceneUpdate(entities=[_entity("path", first_ns, lines=[line])])

    def _header(self, m: pb.LogHeader) -> Iterator[Out]:
        self._mount = frames.camera_mount(m)
        yield from ()

    def _control(self, m: pb.Control) -> Iterator[Out]:
        control = decode.control(m)
        self._path.add(control.pos_world_3, float(np.linalg.norm(control.vel_world_3)))
        at = (control.pos_world_3, control.world_from_body_4)
        yield "/tf", _transform(control.stamp_ns, frames.WORLD, frames.BODY, *at)
        yield "/vehicle/pose", PoseInFrame(timestamp=_time(control.stamp_ns), frame_id=frames.WORLD, pose=_pose(*at))

    def _plan(self, m: pb.Plan) -> Iterator[Out]:
        lines = plan_lines(decode.plan(m), SAMPLES)
        drawn = [
            _line(points_S3, width=1.5, rgb=rgb) for points_S3, rgb in zip(lines.points_NS3, lines.rgb_N3, strict=True)
        ]
        entities = [_entity("candidates", m.ready_ns, LIFETIME_S, lines=drawn)]
        if lines.chosen is not None:
            flown = _line(lines.points_NS3[lines.chosen], width=6.0, rgb=theme.vivid(theme.GOOD))
            entities.append(_entity("chosen", m.ready_ns, LIFETIME_S, lines=[flown]))
        yield "/scene/plan", SceneUpdate(entities=entities)

    def _map(self, m: pb.ObstacleMap) -> Iterator[Out]:
        remembered = decode.remembered(m)
        cloud = PointCloud(
            timestamp=_time(m.stamp_ns),
            frame_id=frames.WORLD,
            pose=_pose(remembered.origin_world_3),
            point_stride=12,
            data=remembered.centre_V3.astype("<f4").tobytes(),
        )
        for k, axis in enumerate(("x", "y", "z")):
            cloud.fields.add(name=axis, offset=4 * k, type=PackedElementField.FLOAT32)
        yield "/remembered", cloud

    def _target(self, m: pb.Target) -> Iterator[Out]:
        target = decode.target(m)
        color = _color(theme.TARGET if target.confirmed else theme.STALE)
        speed = float(np.linalg.norm(target.vel_world_3))
        arrows: list[ArrowPrimitive] = []
        if speed > 0.2:
            shape = {"shaft_diameter": 0.07, "head_diameter": 0.18, "head_length": 0.2, "shaft_length": 0.5 * speed}
            arrows.append(
                ArrowPrimitive(pose=_pose(target.pos_world_3, _towards(target.vel_world_3)), color=color, **shape)
            )
        sphere = SpherePrimitive(pose=_pose(target.pos_world_3), size=Vector3(x=0.35, y=0.35, z=0.35), color=color)
        yield (
            "/scene/target",
            SceneUpdate(entities=[_entity("target", m.stamp_ns, LIFETIME_S, spheres=[sphere], arrows=arrows)]),
        )

    def _truth(self, m: pb.SimTruth) -> Iterator[Out]:
        truth = decode.truth(m)
        if truth.target_pos_world_3 is None:
            return
        person = CylinderPrimitive(
            pose=_pose(truth.target_pos_world_3),
            size=_vector(np.array(PERSON_M)),
            color=_color(theme.TRUTH, 0.5),
            bottom_scale=1.0,
            top_scale=1.0,
        )
        yield "/scene/truth", SceneUpdate(entities=[_entity("target", m.stamp_ns, LIFETIME_S, cylinders=[person])])

    def _rgbd(self, m: pb.CompressedRgbd) -> Iterator[Out]:
        frame = FrameView.of(m)
        at: dict[str, Any] = {"timestamp": _time(m.stamp_ns), "frame_id": frames.OPTICAL}
        yield "/camera/image", CompressedImage(**at, data=m.rgb_png, format="png")
        lens = frames.pinhole(m)
        calibration = CameraCalibration(**at, width=m.width, height=m.height, distortion_model="plumb_bob")
        calibration.D.extend([0.0] * 5)
        calibration.K.extend(lens.k_9)
        calibration.R.extend(np.eye(3).ravel())
        calibration.P.extend(lens.p_12)
        yield "/camera/calibration", calibration
        depth = frames.depth_mm(frame)
        if depth is not None:
            yield (
                "/camera/depth",
                RawImage(**at, width=m.width, height=m.height, step=2 * m.width, encoding="16UC1", data=depth),
            )

    def _preview(self, m: pb.Preview) -> Iterator[Out]:
        at: dict[str, Any] = {"timestamp": _time(m.stamp_ns), "frame_id": frames.OPTICAL}
        yield "/camera/image", CompressedImage(**at, data=m.jpeg, format="jpeg")

    def _event(self, m: pb.Event) -> Iterator[Out]:
        levels = {pb.SEVERITY_WARNING: Log.WARNING, pb.SEVERITY_ERROR: Log.ERROR}
        event = decode.event(m)
        level = levels.get(event.severity, Log.INFO)
        yield "/log", Log(timestamp=_time(m.stamp_ns), level=level, message=event.text, name=event.kind)


def _time(stamp_ns: int) -> Timestamp:
    stamp = Timestamp()
    stamp.FromNanoseconds(stamp_ns)
    return stamp


def _vector(v_3: Array) -> Vector3:
    return Vector3(x=v_3[0], y=v_3[1], z=v_3[2])


def _quaternion(q_4: Array) -> Quaternion:
    return Quaternion(w=q_4[0], x=q_4[1], y=q_4[2], z=q_4[3])


def _pose(pos_3: Array, q_4: Array | None = None) -> Pose:
    identity = Quaternion(w=1.0)
    return Pose(position=_vector(pos_3), orientation=identity if q_4 is None else _quaternion(q_4))


def _towards(direction_3: Array) -> Array:
    """A rotation that turns x to a direction of some length, without roll."""
    yaw = np.arctan2(direction_3[1], direction_3[0])
    pitch = -np.arctan2(direction_3[2], np.hypot(direction_3[0], direction_3[1]))
    cy, sy, cp, sp = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(pitch / 2), np.sin(pitch / 2)
    return np.array([cy * cp, -sy * sp, cy * sp, sy * cp])


def _transform(stamp_ns: int, parent: str, child: str, pos_3: Array, q_4: Array) -> FrameTransform:
    return FrameTransform(
        timestamp=_time(stamp_ns),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=_vector(pos_3),
        rotation=_quaternion(q_4),
    )


def _color(rgb: Sequence[int] | np.ndarray, alpha: float = 1.0) -> Color:
    return Color(r=rgb[0] / 255.0, g=rgb[1] / 255.0, b=rgb[2] / 255.0, a=alpha)


def _line(points_P3: Array, *, width: float, rgb: Sequence[int] | np.ndarray | None = None) -> LinePrimitive:
    """A line through points, ``width`` pixels wide."""
    return LinePrimitive(
        type=LinePrimitive.LINE_STRIP,
        pose=_pose(np.zeros(3)),
        thickness=width,
        scale_invariant=True,
        points=[Point3(x=p[0], y=p[1], z=p[2]) for p in points_P3.tolist()],
        color=None if rgb is None else _color(rgb),
    )


def _entity(name: str, stamp_ns: int, lifetime_s: float = 0.0, **shapes: Any) -> SceneEntity:
    lifetime = Duration()
    lifetime.FromNanoseconds(int(lifetime_s * 1e9))
    return SceneEntity(timestamp=_time(stamp_ns), frame_id=frames.WORLD, id=name, lifetime=lifetime, **shapes)


def _vehicle(stamp_ns: int) -> SceneEntity:
    """A cross of arms that moves with the body, three times its size: 155 mm cannot be seen across a forest."""
    entity = _entity("vehicle", stamp_ns)
    entity.frame_id, entity.frame_locked = frames.BODY, True
    for angle in (np.pi / 4, -np.pi / 4):
        q_4 = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
        arm = CubePrimitive(
            pose=_pose(np.zeros(3), q_4), size=Vector3(x=0.465, y=0.06, z=0.04), color=_color(theme.VEHICLE)
        )
        entity.cubes.append(arm)
    nose = CubePrimitive(
        pose=_pose(np.array([0.15, 0.0, 0.0])), size=Vector3(x=0.12, y=0.08, z=0.06), color=_color(theme.GOOD)
    )
    entity.cubes.append(nose)
    return entity
