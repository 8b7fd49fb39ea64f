"""For Rerun: one .rrd file with its blueprint, so that it opens as scene, camera, plots and events.

The one timeline is ``vehicle``, a duration on the vehicle's clock. What has the same rows throughout goes as columns,
which is quick; what is drawn anew each time (plans) is logged a row at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.exports import frames
from goshawk_dashboards.exports.drawing import FlownPath, plan_lines
from goshawk_dashboards.exports.source import Record
from goshawk_dashboards.log.frame import FrameView
from goshawk_dashboards.page import theme
from goshawk_dashboards.state import decode
from goshawk_dashboards.state.views import Array, ControlView

APPLICATION = "goshawk"
TIMELINE = "vehicle"
SAMPLES = 16
"""Points along a drawn trajectory."""
BLOCK = 4000
"""Controller steps that are kept before they go as columns."""
AXES = ("east", "north", "up")

_BODY, _CAMERA = "world/body", "world/body/camera"
_IMAGE, _DEPTH = f"{_CAMERA}/image", f"{_CAMERA}/depth"
_ACCELERATIONS: tuple[tuple[str, theme.Rgb, Callable[[ControlView], Array | None]], ...] = (
    ("desired", theme.WARN, lambda c: c.acc_des_world_3),
    ("attitude", theme.BAD, lambda c: c.acc_att_world_3),
    ("disturbance", theme.GOOD, lambda c: c.acc_disturbance_world_3),
    ("measured", theme.VEHICLE, lambda c: c.acc_meas_world_3),
)
"""The four of the paper's disturbance figure, in its colours; a simulated flight has the true one beside them."""


def write_rerun(records: Iterable[Record], output: Path) -> dict[str, int]:
    """Writes one .rrd file; rows by entity. Raises OSError if it cannot be written."""
    recording = rr.RecordingStream(APPLICATION)
    # The library's own error for a path that cannot be written is not an OSError.
    output.open("xb").close()
    recording.save(output, default_blueprint=blueprint())
    log = Log(recording)
    for record in records:
        log.take(record)
    log.flush()
    log.draw_path()
    recording.flush()
    recording.disconnect()
    return log.counts


class Log:
    """Logs our messages to a recording of Rerun's."""

    def __init__(self, recording: rr.RecordingStream, path_points: int | None = None) -> None:
        """``path_points``: how much of the flown path is kept; None: all."""
        self._recording = recording
        self._path = FlownPath(path_points)
        self._controls: list[ControlView] = []
        self._seen_lens = False
        self.counts: dict[str, int] = {}
        self._takers: dict[str, Callable[[Any, int], None]] = {
            "header": self._header,
            "control": self._control,
            "imu": self._imu,
            "plan": self._plan,
            "map": self._map,
            "target": self._target,
            "sim_truth": self._truth,
            "rgbd": self._rgbd,
            "preview": self._preview,
            "event": self._event,
        }
        self._stand("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP)
        self._stand(
            f"{_BODY}/model", rr.Boxes3D(half_sizes=[[0.18, 0.18, 0.04]], colors=[theme.VEHICLE], fill_mode="solid")
        )

    def take(self, record: Record) -> None:
        """Logs one message; one that makes no sense is left out."""
        taker = self._takers.get(record.channel)
        if taker is None:
            return
        try:
            taker(record.message, record.log_ns)
        except decode.MalformedError:
            return

    def flush(self) -> None:
        """Logs what goes as columns and has come since the last time."""
        if not self._controls:
            return
        stamps_ns = [c.stamp_ns for c in self._controls]
        pos_M3 = np.array([c.pos_world_3 for c in self._controls])
        vel_M3 = np.array([c.vel_world_3 for c in self._controls])
        xyzw_M4 = np.array([np.roll(c.world_from_body_4, -1) for c in self._controls])
        self._columns(_BODY, stamps_ns, rr.Transform3D.columns(translation=pos_M3, quaternion=xyzw_M4))
        for k, axis in enumerate(AXES):
            for name, color, of in _ACCELERATIONS:
                known = {c.stamp_ns: float(acc_3[k]) for c in self._controls if (acc_3 := of(c)) is not None}
                if known:
                    self._series(f"acceleration/{axis}/{name}", list(known), list(known.values()), color)
            self._series(f"speed/{axis}", stamps_ns, vel_M3[:, k].tolist(), None)
        self._series("speed/total", stamps_ns, np.linalg.norm(vel_M3, axis=1).tolist(), theme.VEHICLE)
        for pos_3, vel_3 in zip(pos_M3, vel_M3, strict=True):
            self._path.add(pos_3, float(np.linalg.norm(vel_3)))
        self._controls.clear()

    def draw_path(self) -> None:
        """Logs the flown path as it is by now, in place of the one before."""
        points_P3, rgb_P3 = self._path.points_P3, self._path.rgb_P3
        if len(points_P3) < 2:
            return
        segments = np.stack([points_P3[:-1], points_P3[1:]], axis=1)
        self._stand("world/path", rr.LineStrips3D(list(segments), colors=rgb_P3[1:], radii=rr.Radius.ui_points(1.5)))

    def _header(self, m: pb.LogHeader, _: int) -> None:
        mount = frames.camera_mount(m)
        if mount is not None:
            xyzw = rr.Quaternion(xyzw=np.roll(mount.body_from_camera_4, -1))
            self._stand(_CAMERA, rr.Transform3D(translation=mount.pos_body_3, quaternion=xyzw))
        for name, toml in [("vehicle_file", m.vehicle_toml), ("tuning_file", m.tuning_toml)]:
            self._stand(name, rr.TextDocument(f"```toml\n{toml}\n```", media_type="text/markdown"))

    def _control(self, m: pb.Control, _: int) -> None:
        self._controls.append(decode.control(m))
        if len(self._controls) >= BLOCK:
            self.flush()

    def _imu(self, m: pb.Imu, log_ns: int) -> None:
        self._row("imu/specific_force", log_ns, rr.Scalars(frames.vec(m.specific_force_body)))
        self._row("imu/angular_velocity", log_ns, rr.Scalars(frames.vec(m.ang_vel_body)))

    def _map(self, m: pb.ObstacleMap, log_ns: int) -> None:
        remembered = decode.remembered(m)
        half_3 = [0.5 * remembered.voxel_m] * 3
        centres_V3 = remembered.origin_world_3 + remembered.centre_V3
        boxes = rr.Boxes3D(centers=centres_V3, half_sizes=[half_3], colors=[theme.REMEMBERED])
        self._row("world/remembered", log_ns, boxes)

    def _plan(self, m: pb.Plan, log_ns: int) -> None:
        plan = decode.plan(m)
        lines = plan_lines(plan, SAMPLES)
        thin, thick = rr.Radius.ui_points(1.0), rr.Radius.ui_points(4.0)
        self._row(
            "world/plan/candidates", log_ns, rr.LineStrips3D(list(lines.points_NS3), colors=lines.rgb_N3, radii=thin)
        )
        chosen = [] if lines.chosen is None else [lines.points_NS3[lines.chosen]]
        green = [theme.vivid(theme.GOOD)]
        self._row("world/plan/chosen", log_ns, rr.LineStrips3D(chosen, colors=green, radii=thick))

    def _target(self, m: pb.Target, log_ns: int) -> None:
        target = decode.target(m)
        color = theme.TARGET if target.confirmed else theme.STALE
        self._row("world/target/estimate", log_ns, rr.Points3D([target.pos_world_3], colors=[color], radii=[0.18]))
        arrow = rr.Arrows3D(vectors=[0.5 * target.vel_world_3], origins=[target.pos_world_3], colors=[color])
        self._row("world/target/velocity", log_ns, arrow)

    def _truth(self, m: pb.SimTruth, log_ns: int) -> None:
        truth = decode.truth(m)
        self._row("truth/clearance", log_ns, rr.Scalars(truth.clearance_m))
        if truth.acc_world_3 is not None:
            for axis, value in zip(AXES, truth.acc_world_3, strict=True):
                self._row(f"acceleration/{axis}/true", log_ns, rr.Scalars(value))
        if truth.target_pos_world_3 is None:
            return
        person = rr.Boxes3D(centers=[truth.target_pos_world_3], half_sizes=[[0.25, 0.25, 0.875]], colors=[theme.TRUTH])
        self._row("world/target/truth", log_ns, person)
        self._row("truth/target_distance", log_ns, rr.Scalars(truth.target_distance_m))

    def _rgbd(self, m: pb.CompressedRgbd, log_ns: int) -> None:
        frame = FrameView.of(m)
        if not self._seen_lens:
            lens = frames.pinhole(m)
            self._seen_lens = True
            image_from_camera_33 = np.array(lens.k_9).reshape(3, 3)
            for entity in (_IMAGE, _DEPTH):
                # The image's axes are right, down, forward; the camera's are FLU: a transform of their own.
                xyzw = rr.Quaternion(xyzw=np.roll(frames.CAMERA_FROM_OPTICAL_4, -1))
                self._stand(entity, rr.Transform3D(quaternion=xyzw))
                self._stand(
                    entity,
                    rr.Pinhole(
                        image_from_camera=image_from_camera_33,
                        resolution=[m.width, m.height],
                        camera_xyz=rr.ViewCoordinates.RDF,
                        image_plane_distance=0.6,
                    ),
                )
        self._row(_IMAGE, log_ns, rr.EncodedImage(contents=m.rgb_png, media_type="image/png"))
        if frame.depth_png:
            depth = rr.EncodedDepthImage(blob=m.depth_png, media_type="image/png", meter=1000.0)
            self._row(_DEPTH, log_ns, depth)

    def _preview(self, m: pb.Preview, log_ns: int) -> None:
        self._row(_IMAGE, log_ns, rr.EncodedImage(contents=m.jpeg, media_type="image/jpeg"))

    def _event(self, m: pb.Event, log_ns: int) -> None:
        event = decode.event(m)
        levels = {pb.SEVERITY_WARNING: rr.TextLogLevel.WARN, pb.SEVERITY_ERROR: rr.TextLogLevel.ERROR}
        level = levels.get(event.severity, rr.TextLogLevel.INFO)
        self._row("events", log_ns, rr.TextLog(f"{event.kind}: {event.text}", level=level))

    def _stand(self, entity: str, archetype: Any) -> None:
        self._recording.log(entity, archetype, static=True)
        self.counts[entity] = self.counts.get(entity, 0) + 1

    def _row(self, entity: str, log_ns: int, archetype: Any) -> None:
        self._recording.set_time(TIMELINE, duration=np.timedelta64(log_ns, "ns"))
        self._recording.log(entity, archetype)
        self.counts[entity] = self.counts.get(entity, 0) + 1

    def _columns(self, entity: str, stamps_ns: Sequence[int], columns: Any) -> None:
        times = rr.TimeColumn(TIMELINE, duration=np.array(stamps_ns, dtype="timedelta64[ns]"))
        rr.send_columns(entity, [times], [*columns], recording=self._recording)
        self.counts[entity] = self.counts.get(entity, 0) + len(stamps_ns)

    def _series(self, entity: str, stamps_ns: Sequence[int], values: list[float], color: theme.Rgb | None) -> None:
        if color is not None:
            self._recording.log(entity, rr.SeriesLines(colors=[color], names=[entity.rsplit("/", 1)[1]]), static=True)
        self._columns(entity, stamps_ns, rr.Scalars.columns(scalars=values))


def blueprint() -> rrb.Blueprint:
    plots = [rrb.TimeSeriesView(origin=f"acceleration/{axis}", name=f"acceleration {axis}, m/s²") for axis in AXES]
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(origin="world", name="scene"),
                rrb.TextLogView(origin="events", name="events"),
                row_shares=[4, 1],
            ),
            rrb.Vertical(
                rrb.Spatial2DView(origin=_IMAGE, name="camera"),
                rrb.TimeSeriesView(origin="speed", name="speed, m/s"),
                *plots,
                row_shares=[3, 2, 2, 2, 2],
            ),
            column_shares=[3, 2],
        ),
        collapse_panels=True,
    )
