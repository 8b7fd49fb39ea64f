"""From a camera's frames to the key that the vehicle listens on."""

from __future__ import annotations

import threading
from collections.abc import Generator
from contextlib import contextmanager

import zenoh

from goshawk_sensors.cameras.source import Frame, Source
from goshawk_sensors.keeping import Say
from goshawk_sensors.setup.errors import CameraError
from goshawk_sensors.setup.profile import Profile
from goshawk_sensors.setup.vehicle import Wanted
from goshawk_sensors.view.resample import Millimetres, Resampler

try:
    from goshawk_proto import KEYS, LinkError, client_config, goshawk_pb2, key_expression
except ModuleNotFoundError as error:
    raise CameraError(
        f"the package goshawk is not here ({error}): install it from the same checkout (make setup-camera, or pip "
        "install . ./air/sensors), for the package index's goshawk is another project's"
    ) from error

DIAL_AGAIN_S = 0.5


class Images:
    """Frames as the policy wants them: the tables are made for the first frame of each source."""

    def __init__(self, wanted: Wanted, profile: Profile) -> None:
        self._wanted, self._profile = wanted, profile
        self._source: Source | None = None
        self._resampler: Resampler | None = None
        self._count = 0

    def of(self, source: Source) -> Resampler:
        """Raises CameraError if the camera's view does not do."""
        if self._resampler is None or source is not self._source:
            self._source = source
            profile = self._profile
            self._resampler = Resampler(source.rig, self._wanted, profile.align, profile.depth.clip_m, rim=profile.rim)
        return self._resampler

    def message(self, source: Source, frame: Frame) -> tuple[goshawk_pb2.Rgbd, Millimetres]:
        """What is sent, and its depth."""
        resampler = self.of(source)
        rgb, depth_mm = resampler(frame.colour_HW3, frame.depth_HW)
        self._count += 1
        return (
            goshawk_pb2.Rgbd(
                seq=self._count, stamp_ns=frame.stamp.monotonic_ns, width=resampler.view.width,
                height=resampler.view.height, hfov_rad=resampler.hfov_rad, vfov_rad=resampler.vfov_rad,
                rgb=rgb.tobytes(), depth_mm=depth_mm.astype("<u2", copy=False).tobytes(),
            ),
            depth_mm,
        )  # fmt: skip


@contextmanager
def publisher(vehicle: str, endpoint: str, ending: threading.Event, say: Say) -> Generator[zenoh.Publisher | None]:
    """Dials until the vehicle answers, and from then on whenever it was away; None: ended before it answered.

    Raises CameraError if endpoint or name cannot be one.
    """
    row = KEYS["rgbd"]
    try:
        key, config = key_expression("rgbd", vehicle), client_config(endpoint)
    except (LinkError, ValueError) as error:
        raise CameraError(str(error)) from error
    session = _dialled(config, endpoint, ending, say)
    if session is None:
        yield None
        return
    with session:
        yield session.declare_publisher(
            key,
            encoding=row.encoding,
            congestion_control=row.congestion,
            priority=row.priority,
            express=row.express,
        )


def _dialled(config: zenoh.Config, endpoint: str, ending: threading.Event, say: Say) -> zenoh.Session | None:
    said = False
    while not ending.is_set():
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            if not said:
                say(f"nothing answers at {endpoint}: start goshawk-air there; dialling until it does")
                said = True
            ending.wait(DIAL_AGAIN_S)
    return None
