"""An OAK-D by depthai 3. UNTRIED: held to depthai's own signatures by tests, run on no camera yet.

The camera brings its depth onto the colour's view and takes the lens' distortion out of both, so they share one lens.
"""

from __future__ import annotations

import time
from datetime import timedelta
from typing import Any

import numpy as np

from goshawk_sensors.cameras.clock import Stamp
from goshawk_sensors.cameras.source import Frame
from goshawk_sensors.setup.errors import CameraError, NoCameraError
from goshawk_sensors.setup.profile import Image, Profile
from goshawk_sensors.view.pinhole import Lens, Rig

MOMENT = timedelta(milliseconds=100)
SILENT_S = 5.0
"""A camera that sends nothing for this long is gone: it is opened again."""


def open_live(profile: Profile, wanted_serial: str | None) -> Oak:
    """The camera with this id, or the first. Raises NoCameraError if none is there, CameraError without depthai."""
    if profile.align != "colour":
        raise CameraError('an OAK-D brings depth onto colour: say align = "colour" in the profile')
    if profile.depth.preset is not None or profile.depth.emitter is not None:
        raise CameraError("preset and emitter are a RealSense's: leave them out of an OAK-D's profile")
    try:
        import depthai as dai  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise CameraError(
            "an OAK-D needs depthai: install it beside goshawk-sensors (docs/how-to/camera.md, An OAK-D)"
        ) from error
    try:
        return Oak(dai, dai.Device(wanted_serial) if wanted_serial else dai.Device(), profile)
    except RuntimeError as error:
        raise NoCameraError(
            f"no OAK-D answers ({' '.join(str(error).split())}): see its cable and USB 3 port"
        ) from error


class Oak:
    """A camera that streams."""

    def __init__(self, dai: Any, device: Any, profile: Profile) -> None:
        self.name = f"OAK-D {device.getDeviceId()}"
        self._dai, self._device, self._pipeline = dai, device, dai.Pipeline(device)
        sockets, rate_hz = dai.CameraBoardSocket, profile.rate_hz
        eyes = [self._pipeline.create(dai.node.Camera).build(socket) for socket in (sockets.CAM_B, sockets.CAM_C)]
        eye = self._pipeline.create(dai.node.Camera).build(sockets.CAM_A)
        for each, image in ((eyes[0], profile.depth), (eyes[1], profile.depth), (eye, profile.colour)):
            _expose(each, image)
        stereo = self._pipeline.create(dai.node.StereoDepth).build(
            *(each.requestOutput(profile.depth.size, fps=rate_hz) for each in eyes)
        )
        colour = eye.requestOutput(profile.colour.size, dai.ImgFrame.Type.RGB888i, fps=rate_hz, enableUndistortion=True)
        colour.link(stereo.inputAlignTo)
        stereo.setOutputSize(*profile.colour.size)
        pairs = self._pipeline.create(dai.node.Sync)
        pairs.setSyncThreshold(timedelta(seconds=0.5 / rate_hz))
        colour.link(pairs.inputs["colour"])
        stereo.depth.link(pairs.inputs["depth"])
        self._queue = pairs.out.createOutputQueue(maxSize=1, blocking=False)
        lens = _lens(device.readCalibration(), sockets.CAM_A, profile.colour)
        self.rig = Rig(
            colour=lens, depth=lens, rotation_33=np.eye(3, dtype=np.float32), translation_3=np.zeros(3, np.float32)
        )
        self._pipeline.start()
        self._heard_s = time.monotonic()

    def read(self) -> Frame | None:
        """The next pair, a moment's silence, or NoCameraError after a long one."""
        try:
            group = self._queue.get(MOMENT)
        except (RuntimeError, self._dai.MessageQueue.QueueException) as error:  # the latter is no RuntimeError
            raise NoCameraError(f"{self.name} is gone") from error
        now_s = time.monotonic()
        if group is None:
            if now_s - self._heard_s > SILENT_S:
                raise NoCameraError(f"{self.name} is silent")
            return None
        self._heard_s = now_s
        colour, depth = group["colour"], group["depth"]
        # depthai's host clock is std::chrono::steady_clock, which is CLOCK_MONOTONIC here.
        taken = depth.getTimestamp(self._dai.CameraExposureOffset.MIDDLE)
        return Frame(
            colour_HW3=colour.getFrame(),
            depth_HW=depth.getFrame(),
            stamp=Stamp(monotonic_ns=taken // timedelta(microseconds=1) * 1000, source="the camera's, of depthai"),
            arrival_ns=time.monotonic_ns(),
            number=depth.getSequenceNum(),
        )

    def close(self) -> None:
        """Safe to call twice. The device is let go too, or it could not be opened again."""
        self._pipeline.stop()
        self._device.close()


def _expose(camera: Any, image: Image) -> None:
    if image.exposure_us is not None:
        camera.initialControl.setManualExposure(image.exposure_us, 400)  # ISO 400: a fixed gain goes with it
    elif image.auto_exposure:
        camera.initialControl.setAutoExposureEnable()


def _lens(calibration: Any, socket: Any, image: Image) -> Lens:
    width, height = image.size
    (fx, _, cx), (_, fy, cy), _ = calibration.getCameraIntrinsics(socket, width, height)
    return Lens(width=width, height=height, fx=fx, fy=fy, cx=cx, cy=cy)
