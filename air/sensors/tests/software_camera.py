"""A RealSense made of librealsense's own software device: it is opened, set up, recorded and played like a real one."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from goshawk_sensors.cameras.librealsense import Handle, rs
from goshawk_sensors.view.pinhole import Lens, Rig
from goshawk_sensors.view.resample import Colour, Millimetres


@dataclass(kw_only=True)
class Shot:
    """A pair of images and what the camera says of their time."""

    colour_HW3: Colour
    depth_HW: Millimetres
    wall_ms: float
    metadata: dict[Handle, int] = field(default_factory=dict[Handle, int])


class SoftwareCamera:
    """Two sensors, their streams and whatever options the test gives it."""

    def __init__(
        self,
        rig: Rig,
        serial: str = "0815",
        rate_hz: int = 30,
        options: Iterable[Handle] = (),
        colour: Handle = rs.format.rgb8,
    ) -> None:
        self.device = rs.software_device()
        self.device.register_info(rs.camera_info.name, "Software D455")
        self.device.register_info(rs.camera_info.serial_number, serial)
        self._depth = self.device.add_sensor("Stereo Module")
        self._colour = self.device.add_sensor("RGB Camera")
        depth = self._depth.add_video_stream(_stream(rs.stream.depth, 0, rs.format.z16, 2, rig.depth, rate_hz), True)
        bytes_each = 4 if colour == rs.format.rgba8 else 3
        colour = self._colour.add_video_stream(
            _stream(rs.stream.color, 1, colour, bytes_each, rig.colour, rate_hz), True
        )
        self._profiles = depth.as_video_stream_profile(), colour.as_video_stream_profile()
        _join(depth, colour, rig.rotation_33, rig.translation_3)
        _join(colour, depth, rig.rotation_33.T, -rig.rotation_33.T @ rig.translation_3)
        self._unit_m = rig.depth_unit_mm / 1000.0
        self._depth.add_read_only_option(rs.option.depth_units, self._unit_m)
        span = rs.option_range()
        span.min, span.max, span.step, span.default = 0.0, 100_000.0, 1.0, 0.0
        for option in options:
            self._depth.add_option(option, span, True)
        self.device.create_matcher(rs.matchers.default)
        self._rate_hz, self._count = rate_hz, 0

    @property
    def depth_sensor(self) -> Handle:
        return self._depth

    def shoot(self, shot: Shot) -> None:
        """Delivers one pair."""
        self._count += 1
        for sensor, profile, pixels in (
            (self._depth, self._profiles[0], shot.depth_HW),
            (self._colour, self._profiles[1], shot.colour_HW3),
        ):
            for key, value in shot.metadata.items():
                sensor.set_metadata(key, value)
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp = pixels.copy(), pixels.itemsize * (pixels.shape[2] if pixels.ndim == 3 else 1)
            frame.stride = profile.width() * frame.bpp
            frame.timestamp, frame.domain, frame.frame_number = (
                shot.wall_ms,
                rs.timestamp_domain.global_time,
                self._count,
            )
            frame.profile = profile
            if sensor is self._depth:
                frame.depth_units = self._unit_m
            sensor.on_video_frame(frame)

    def record(self, path: Path, shots: Iterable[Shot]) -> Path:
        """A recording of these, written by librealsense as they come: it is played as fast as it was written."""
        recorder = rs.recorder(str(path), self.device)
        sensors = recorder.query_sensors()
        queue = rs.frame_queue(2)
        for sensor in sensors:
            sensor.open(sensor.get_stream_profiles()[0])
            sensor.start(queue)
        begun_s = time.monotonic()
        for k, shot in enumerate(shots):
            time.sleep(max(0.0, begun_s + k / self._rate_hz - time.monotonic()))
            self.shoot(shot)
        for sensor in sensors:
            sensor.stop()
            sensor.close()
        return path


def _stream(kind: Handle, uid: int, pixels: Handle, bpp: int, lens: Lens, rate_hz: int) -> Handle:
    stream, found = rs.video_stream(), rs.intrinsics()
    found.width, found.height, found.fx, found.fy, found.ppx, found.ppy = (
        lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy,
    )  # fmt: skip
    found.model, found.coeffs = rs.distortion.brown_conrady, list(lens.coefficients)
    stream.type, stream.uid, stream.index, stream.fmt, stream.bpp = kind, uid, 0, pixels, bpp
    stream.width, stream.height, stream.fps, stream.intrinsics = lens.width, lens.height, rate_hz, found
    return stream


def _join(one: Handle, other: Handle, rotation_33: np.ndarray, move_3: np.ndarray) -> None:
    moved = rs.extrinsics()
    moved.rotation = [float(each) for each in rotation_33.T.reshape(-1)]
    moved.translation = [float(each) for each in move_3]
    one.register_extrinsics_to(other, moved)
