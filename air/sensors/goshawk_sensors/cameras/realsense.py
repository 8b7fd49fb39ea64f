"""A RealSense by librealsense: live, or from a recording of one (.db3, and .bag of librealsense before 2.58)."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from goshawk_sensors.cameras import clock, recording
from goshawk_sensors.cameras.librealsense import Handle, rs
from goshawk_sensors.cameras.recorder import RecordedFile
from goshawk_sensors.cameras.source import Frame
from goshawk_sensors.setup.errors import CameraError, EndOfRecordingError, NoCameraError, RecordingError
from goshawk_sensors.setup.profile import Depth, Image, Profile
from goshawk_sensors.view.pinhole import Distortion, Lens, Rig

MOMENT_MS = 100
"""How long a read waits: so soon Ctrl-C is heeded."""
FIRST_S, SILENT_S = 5.0, 1.0
"""A camera that sends nothing for this long, at its start and later, is gone: it is opened again."""

_DISTORTIONS: dict[Handle, Distortion] = {
    rs.distortion.none: "none",
    rs.distortion.brown_conrady: "brown_conrady",
    rs.distortion.modified_brown_conrady: "modified_brown_conrady",
    rs.distortion.inverse_brown_conrady: "modified_brown_conrady",  # librealsense projects both alike
}


def cameras(context: Handle | None = None) -> list[Handle]:
    """Those that are plugged in. Raises NoCameraError where they cannot be asked."""
    try:
        return list((context or rs.context()).query_devices())
    except RuntimeError as error:
        raise NoCameraError(f"the cameras cannot be listed: {' '.join(str(error).split())}") from error


def describe(device: Handle) -> str:
    """Model and serial number."""
    return f"{_info(device, rs.camera_info.name)} {_info(device, rs.camera_info.serial_number)}".strip()


def serial(device: Handle) -> str:
    return _info(device, rs.camera_info.serial_number)


def open_live(
    profile: Profile,
    wanted_serial: str | None,
    record: RecordedFile | None,
    find: Callable[[], list[Handle]] | None = None,
) -> RealSense:
    """The camera with this serial number, or the only one. ``record``: a file that gets all that it sends.

    Raises NoCameraError if it is not there, CameraError if it cannot do what the profile asks, RecordingError if the
    file cannot be written.
    """
    try:
        return _open_live(profile, wanted_serial, record, (find or cameras)())
    except RuntimeError as error:  # one that has just been plugged in, or pulled out, refuses whatever it is asked
        raise NoCameraError(f"the camera does not answer: {' '.join(str(error).split())}") from error


def _open_live(
    profile: Profile, wanted_serial: str | None, record: RecordedFile | None, found: list[Handle]
) -> RealSense:
    chosen = [device for device in found if wanted_serial in (None, serial(device))]
    there = ", ".join(describe(device) for device in found)
    if not chosen:
        asked = "no RealSense" if wanted_serial is None else f"no RealSense {wanted_serial}"
        raise NoCameraError(f"{asked} is plugged in{f', only {there}' if there else ''}: see its cable and USB 3 port")
    if len(chosen) > 1:
        raise CameraError(f"several are plugged in: name one with --serial ({there})")
    return RealSense(chosen[0], profile, record)


def open_recording(path: Path, profile: Profile) -> Recording:
    """Raises CameraError if it cannot be played."""
    if not path.is_file():
        raise CameraError(f"no recording {path}")
    return Recording(path, profile)


class RealSense:
    """A camera that streams. Frees it with `close`."""

    def __init__(self, device: Handle, profile: Profile, record: RecordedFile | None = None) -> None:
        self.name = describe(device)
        self._latency_ms, self._record = profile.latency_ms, record
        for sensor in device.query_sensors():
            _set_up(sensor, profile)
        config = rs.config()
        config.enable_stream(rs.stream.depth, *profile.depth.size, rs.format.z16, profile.rate_hz)
        config.enable_stream(rs.stream.color, *profile.colour.size, rs.format.rgb8, profile.rate_hz)
        self._stream = _Stream(device, config, f"{self.name} does not start as the profile says", record)
        self.rig = self._stream.rig
        self._silent_at_s = time.monotonic() + FIRST_S

    def read(self) -> Frame | None:
        """The next pair, a moment's silence, or NoCameraError after a long one."""
        if self._record is not None:
            self._record.look()
        pair = self._stream.read()
        if pair is None:
            if time.monotonic() > self._silent_at_s:
                raise NoCameraError(f"{self.name} is silent")
            return None
        self._silent_at_s = time.monotonic() + SILENT_S
        arrival = clock.now()
        return _frame(self._stream, pair, clock.stamp(_told(pair[1]), arrival, self._latency_ms), arrival.monotonic_ns)

    def close(self) -> None:
        self._stream.close()  # it writes what it has yet to write
        if self._record is not None:
            self._record.look()


class Recording:
    """A file that is played as fast as it was taken, from the first read on."""

    def __init__(self, path: Path, profile: Profile) -> None:
        self.name = str(path)
        self._context = rs.context()
        try:
            self._playback = self._context.load_device(str(path))
        except RuntimeError as error:
            raise CameraError(f"{path} cannot be played: {' '.join(str(error).split())}") from error
        self._playback.pause()  # or it plays while the pipeline starts, and the first images are lost
        self._paused = True
        config = rs.config()
        config.enable_all_streams()
        self._replayed = clock.Replayed()
        self._stream = _Stream(self._playback, config, f"{path} cannot be played")
        self.rig = self._stream.rig

    def read(self) -> Frame | None:
        """The next pair; EndOfRecordingError after the last."""
        if self._paused:
            self._playback.resume()
            self._paused = False
        pair = self._stream.read()
        if pair is None:
            if self._playback.current_status() == rs.playback_status.stopped:
                raise EndOfRecordingError
            return None
        arrival_ns = time.monotonic_ns()
        return _frame(self._stream, pair, self._replayed.stamp(pair[1].get_timestamp(), arrival_ns), arrival_ns)

    def close(self) -> None:
        self._stream.close()


Pair = tuple[Handle, Handle]


class _Stream:
    """Pairs of colour and depth that belong together, from librealsense's own pipeline."""

    def __init__(self, device: Handle, config: Handle, complaint: str, record: RecordedFile | None = None) -> None:
        pipeline = rs.pipeline()
        self._pipeline: Handle | None = pipeline
        pipeline.set_device(device)
        try:
            if record is not None:
                recording.begin(config, pipeline, record)
            started = pipeline.start(config)
            colour, depth = (started.get_stream(which) for which in (rs.stream.color, rs.stream.depth))
            _check_formats(colour.format(), depth.format())
            self._swapped = colour.format() == rs.format.bgr8
            self.rig = _rig(device, colour.as_video_stream_profile(), depth.as_video_stream_profile())
        except RecordingError:
            self.close()
            raise
        except (RuntimeError, CameraError) as error:
            self.close()
            raise CameraError(f"{complaint}: {' '.join(str(error).split())}") from error

    def read(self) -> Pair | None:
        assert self._pipeline is not None
        try:
            arrived, frames = self._pipeline.try_wait_for_frames(MOMENT_MS)
        except RuntimeError as error:  # pulled out, and librealsense could not start it again
            raise NoCameraError(f"it is gone: {' '.join(str(error).split())}") from error
        if not arrived:
            return None
        colour, depth = frames.get_color_frame(), frames.get_depth_frame()
        return (colour, depth) if colour and depth else None

    def rgb(self, colour: Handle) -> NDArray[np.uint8]:
        """A colour frame's pixels, (height, width, 3)."""
        pixels_HW3 = np.asanyarray(colour.get_data())
        return np.ascontiguousarray(pixels_HW3[:, :, ::-1]) if self._swapped else pixels_HW3

    def close(self) -> None:
        pipeline, self._pipeline = self._pipeline, None
        if pipeline is not None:
            try:
                pipeline.stop()
            except RuntimeError:
                return  # it never started, or the camera was pulled out


def _check_formats(colour: Handle, depth: Handle) -> None:
    """Raises CameraError for pixels that nobody here reads; another program may have recorded any."""
    if colour not in (rs.format.rgb8, rs.format.bgr8):
        raise CameraError(f"its colour is {colour.name}: record rgb8 or bgr8")
    if depth != rs.format.z16:
        raise CameraError(f"its depth is {depth.name}: record z16")


def _frame(stream: _Stream, pair: Pair, stamp: clock.Stamp, arrival_ns: int) -> Frame:
    colour, depth = pair
    return Frame(
        colour_HW3=stream.rgb(colour),
        depth_HW=np.asanyarray(depth.get_data()),
        stamp=stamp,
        arrival_ns=arrival_ns,
        number=depth.get_frame_number(),
    )


def _told(frame: Handle) -> clock.Told:
    def metadata(key: Handle) -> int | None:
        return frame.get_frame_metadata(key) if frame.supports_frame_metadata(key) else None

    by_wall = frame.get_frame_timestamp_domain() == rs.timestamp_domain.global_time
    return clock.Told(
        wall_ms=frame.get_timestamp() if by_wall else None,
        frame_us=metadata(rs.frame_metadata_value.frame_timestamp),
        sensor_us=metadata(rs.frame_metadata_value.sensor_timestamp),
        exposure_us=metadata(rs.frame_metadata_value.actual_exposure),
    )


def _rig(device: Handle, colour: Handle, depth: Handle) -> Rig:
    moved = depth.get_extrinsics_to(colour)
    # librealsense writes rotations column by column.
    return Rig(
        colour=_lens(colour.get_intrinsics()),
        depth=_lens(depth.get_intrinsics()),
        rotation_33=np.array(moved.rotation, dtype=np.float32).reshape(3, 3).T,
        translation_3=np.array(moved.translation, dtype=np.float32),
        depth_unit_mm=round(1000.0 * device.first_depth_sensor().get_depth_scale(), 6),
    )


def _lens(found: Handle) -> Lens:
    if found.model not in _DISTORTIONS:
        raise CameraError(f"its lens is {found.model}, which is not known here: choose another mode or camera")
    return Lens(
        width=found.width, height=found.height, fx=found.fx, fy=found.fy, cx=found.ppx, cy=found.ppy,
        distortion=_DISTORTIONS[found.model], coefficients=tuple(found.coeffs),
    )  # fmt: skip


def _set_up(sensor: Handle, profile: Profile) -> None:
    """What the profile says of this sensor. Raises CameraError for what it cannot do."""
    is_depth, is_colour = sensor.is_depth_sensor(), sensor.is_color_sensor()
    if not (is_depth or is_colour):
        return
    if sensor.supports(rs.option.global_time_enabled):
        sensor.set_option(rs.option.global_time_enabled, 1.0)
    image: Image = profile.depth if is_depth else profile.colour
    if is_depth:
        _set_up_depth(sensor, profile.depth)
    if image.auto_exposure:
        _set(sensor, "auto_exposure", rs.option.enable_auto_exposure, 1.0)
    if image.exposure_us is not None:
        _set(sensor, "exposure_us", rs.option.enable_auto_exposure, 0.0)
        # Only the depth sensors count in microseconds: a colour sensor's step is 100 of them.
        _set(sensor, "exposure_us", rs.option.exposure, image.exposure_us if is_depth else image.exposure_us / 100)


def _set_up_depth(sensor: Handle, depth: Depth) -> None:
    if depth.preset is not None:
        option = rs.option.visual_preset
        names = _names(sensor, option) if sensor.supports(option) else []
        if depth.preset not in names:
            raise CameraError(f"the camera has no preset '{depth.preset}': {', '.join(filter(None, names)) or 'none'}")
        _set(sensor, "preset", option, float(names.index(depth.preset)))
    if depth.emitter is not None:
        _set(sensor, "emitter", rs.option.emitter_enabled, float(depth.emitter))


def _names(sensor: Handle, option: Handle) -> list[str]:
    most = int(sensor.get_option_range(option).max)
    return [sensor.get_option_value_description(option, float(value)) or "" for value in range(most + 1)]


def _set(sensor: Handle, key: str, option: Handle, value: float) -> None:
    name = sensor.get_info(rs.camera_info.name)
    if not sensor.supports(option):
        raise CameraError(f"the camera's {name} has no {option.name}: leave {key} out of the profile")
    try:
        sensor.set_option(option, value)
    except RuntimeError as error:
        raise CameraError(f"the camera's {name} refuses {key}: {' '.join(str(error).split())}") from error


def _info(device: Handle, what: Handle) -> str:
    return device.get_info(what) if device.supports(what) else ""
