"""A live camera, by librealsense's software device: settings, stamps, serial numbers, unplugging, recording."""

from __future__ import annotations

import shutil
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np
import pytest
from camera_process import VEHICLE
from goshawk_sensors import cli, feed, keeping
from goshawk_sensors.cameras import realsense
from goshawk_sensors.cameras.librealsense import Handle, rs
from goshawk_sensors.cameras.recorder import RecordedFile, Recorder, unused
from goshawk_sensors.cameras.source import Frame
from goshawk_sensors.setup.errors import CameraError, EndOfRecordingError, NoCameraError
from goshawk_sensors.setup.profile import Depth, Image, Profile
from goshawk_sensors.view.pinhole import Rig
from lenses import rig
from software_camera import Shot, SoftwareCamera
from typer.testing import CliRunner

SIZE = (320, 192)
PROFILE = Profile(
    driver="realsense", rate_hz=30, align="depth", latency_ms=30.0, colour=Image(size=SIZE),
    depth=Depth(size=SIZE, clip_m=(0.2, 12.0)),
)  # fmt: skip
MIDDLE_BEFORE_MS, READ_OUT_MS = 6, 2
"""Of the made-up exposure: how long before the read-out began its middle was, and how long before now that was."""


def with_depth(**changes: object) -> Profile:
    return msgspec.structs.replace(PROFILE, depth=msgspec.structs.replace(PROFILE.depth, **changes))


@contextmanager
def filming(camera: SoftwareCamera, *, metadata: bool = True) -> Generator[Callable[[], None]]:
    """The camera delivers 30 pairs a second; what is yielded pulls its plug."""
    unplugged = threading.Event()

    def film() -> None:
        colour, depth = np.full((192, 320, 3), 77, np.uint8), np.full((192, 320), 3000, np.uint16)
        told = {
            rs.frame_metadata_value.frame_timestamp: 1_000_000 + 1000 * MIDDLE_BEFORE_MS,
            rs.frame_metadata_value.sensor_timestamp: 1_000_000,
        }
        while not unplugged.wait(1 / 30):
            wall_ms = time.time() * 1000.0 - READ_OUT_MS
            camera.shoot(Shot(colour_HW3=colour, depth_HW=depth, wall_ms=wall_ms, metadata=told if metadata else {}))

    thread = threading.Thread(target=film)
    thread.start()

    def unplug() -> None:
        unplugged.set()
        thread.join()

    try:
        yield unplug
    finally:
        unplug()


def said_by_nobody(text: str) -> None:
    raise AssertionError(text)


def opened(
    *cameras: SoftwareCamera, profile: Profile = PROFILE, serial: str | None = None, record: Path | None = None
) -> realsense.RealSense:
    file = None if record is None else RecordedFile(record, Recorder(record, said_by_nobody))
    return realsense.open_live(profile, serial, file, lambda: [camera.device for camera in cameras])


def next_frame(source: realsense.RealSense | realsense.Recording) -> Frame:
    while True:
        frame = source.read()
        if frame is not None:
            return frame


def test_an_image_is_stamped_with_the_middle_of_its_exposure_on_the_monotonic_clock() -> None:
    camera = SoftwareCamera(rig(SIZE))
    source = opened(camera)
    with filming(camera):
        frame = next_frame(source)
        source.close()
    assert frame.stamp.source == "the sensor's timestamp"
    age_ms = 1e-6 * (frame.arrival_ns - frame.stamp.monotonic_ns)
    assert MIDDLE_BEFORE_MS + READ_OUT_MS <= age_ms < 250.0
    assert np.all(frame.colour_HW3 == 77)
    assert np.all(frame.depth_HW == 3000)


def test_without_metadata_the_stamp_is_the_arrival_less_what_the_profile_says() -> None:
    camera = SoftwareCamera(rig(SIZE))
    source = opened(camera)
    with filming(camera, metadata=False):
        frame = next_frame(source)
        source.close()
    assert frame.stamp.source == "its arrival less 30 ms"
    assert frame.arrival_ns - frame.stamp.monotonic_ns == 30_000_000


def test_emitter_and_exposure_are_set_as_the_profile_says() -> None:
    wanted = {rs.option.emitter_enabled: 1.0, rs.option.enable_auto_exposure: 0.0, rs.option.exposure: 8000.0}
    camera = SoftwareCamera(rig(SIZE), options=wanted)
    camera.depth_sensor.set_option(rs.option.enable_auto_exposure, 1.0)
    opened(camera, profile=with_depth(emitter=True, exposure_us=8000)).close()
    assert {option: camera.depth_sensor.get_option(option) for option in wanted} == wanted


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"emitter": True}, "has no emitter_enabled: leave emitter out of the profile"),
        ({"preset": "High Density"}, "no preset 'High Density'"),
        ({"size": (640, 480)}, "does not start as the profile says"),
    ],
)
def test_what_the_camera_cannot_do_is_named(changes: dict[str, object], said: str) -> None:
    with pytest.raises(CameraError, match=said):
        opened(SoftwareCamera(rig(SIZE)), profile=with_depth(**changes))


def test_the_serial_number_chooses_among_several_and_must_where_there_are() -> None:
    one, two = SoftwareCamera(rig(SIZE), serial="1"), SoftwareCamera(rig(SIZE), serial="2")
    source = opened(one, two, serial="2")
    source.close()
    assert source.name == "Software D455 2"
    with pytest.raises(CameraError, match=r"name one with --serial \(Software D455 1, Software D455 2\)"):
        opened(one, two)
    with pytest.raises(NoCameraError, match="no RealSense 3 is plugged in, only Software D455 1"):
        opened(one, two, serial="3")


def test_a_camera_that_is_unplugged_is_looked_for_and_goes_on_when_it_is_back() -> None:
    before, after = SoftwareCamera(rig(SIZE)), SoftwareCamera(rig(SIZE))
    plugged, looked, said, ending = [before.device], list[int](), list[str](), threading.Event()

    def find() -> list[Handle]:
        looked.append(len(plugged))
        if len(looked) == 3:  # the second time that it is looked for in vain it is plugged in again
            plugged.append(after.device)
        return list(plugged)

    def opening() -> realsense.RealSense:
        return realsense.open_live(PROFILE, None, None, find)

    frames = keeping.frames(opening(), opening, ending, said.append)
    with filming(before) as unplug:
        source, _ = next(frames)
        unplug()
        plugged.clear()
        with filming(after):
            again, frame = next(frames)
            assert again is not source
            assert np.all(frame.depth_HW == 3000)
            ending.set()
            assert list(frames) == []
    assert said == [
        "Software D455 0815 is silent: looking for it",
        "no RealSense is plugged in: see its cable and USB 3 port; still looking",
        "Software D455 0815 is there",
    ]
    assert looked[0] == 1 and looked[1] == 0


def test_a_camera_that_refuses_what_it_is_asked_is_gone_and_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuses(*_: object) -> None:
        raise RuntimeError("hwmon command 0x10 failed")

    with monkeypatch.context() as patch:
        patch.setattr(realsense, "_set_up", refuses)
        with pytest.raises(NoCameraError, match="does not answer: hwmon command"):
            opened(SoftwareCamera(rig(SIZE)))
    source = opened(SoftwareCamera(rig(SIZE)))
    # As librealsense leaves it where it could not start again what was pulled out.
    source._stream._pipeline.stop()  # pyright: ignore[reportPrivateUsage,reportOptionalMemberAccess]
    with pytest.raises(NoCameraError, match="it is gone"):
        source.read()
    source.close()


def test_who_only_looks_waits_for_no_camera_and_a_time_ends_without_images() -> None:
    source, said = opened(SoftwareCamera(rig(SIZE))), list[str]()
    frames = keeping.frames(source, opened, threading.Event(), said.append, until_s=time.monotonic() + 0.3)
    assert list(frames) == []
    source = opened(SoftwareCamera(rig(SIZE)))
    with pytest.raises(NoCameraError, match="is silent"):
        next(keeping.frames(source, opened, threading.Event(), said.append, again=False))
    assert said == []


def recorded_as(form: Handle, pixel: tuple[int, ...], file: Path) -> Path:
    """Ten images of one colour, as another program writes them."""
    colour = np.broadcast_to(np.array(pixel, np.uint8), (192, 320, len(pixel))).copy()
    depth = np.full((192, 320), 3000, np.uint16)
    shots = [Shot(colour_HW3=colour, depth_HW=depth, wall_ms=1000.0 + 33.0 * k) for k in range(10)]
    return SoftwareCamera(rig(SIZE), colour=form).record(file, shots)


@pytest.mark.parametrize(("form", "sent"), [(rs.format.bgr8, (30, 20, 200)), (rs.format.rgb8, (200, 20, 30))])
def test_a_recording_of_another_program_keeps_its_colours(
    form: Handle, sent: tuple[int, int, int], tmp_path: Path
) -> None:
    played = realsense.open_recording(recorded_as(form, (200, 20, 30), tmp_path / "other.db3"), PROFILE)
    assert tuple(next_frame(played).colour_HW3[0, 0]) == sent
    played.close()


def test_pixels_that_nobody_reads_are_refused_with_what_to_record(tmp_path: Path) -> None:
    file = recorded_as(rs.format.rgba8, (200, 20, 30, 255), tmp_path / "other.db3")
    with pytest.raises(CameraError, match="its colour is rgba8: record rgb8 or bgr8"):
        realsense.open_recording(file, PROFILE)


def test_a_recording_is_never_overwritten(tmp_path: Path) -> None:
    file = tmp_path / "walk.db3"
    assert unused(file) == file
    file.touch()
    (tmp_path / "walk-2.db3").touch()
    assert unused(file) == tmp_path / "walk-3.db3"


def test_waiting_for_a_camera_ends_when_it_is_told_to() -> None:
    ending, said = threading.Event(), list[str]()

    def opening() -> realsense.RealSense:
        ending.set()
        return opened()

    assert keeping.begun(opening, ending, said.append, wait=True) is None
    assert len(said) == 1


def test_what_is_recorded_while_it_is_sent_can_be_played_from_its_first_image(tmp_path: Path) -> None:
    camera, file = SoftwareCamera(rig(SIZE)), tmp_path / "kept.db3"
    source = opened(camera, record=file)
    with filming(camera):
        sent = [next_frame(source).number for _ in range(10)]
        source.close()
    played = realsense.open_recording(file, PROFILE)
    time.sleep(0.5)  # longer than it plays: it waits for who reads it
    numbers = list[int]()
    with pytest.raises(EndOfRecordingError):
        while True:
            frame = next_frame(played)
            assert np.all(frame.colour_HW3 == 77)
            assert np.all(frame.depth_HW == 3000)
            numbers.append(frame.number)
    played.close()
    # It plays in real time, so a busy machine may leave some out.
    assert numbers == sorted(set(numbers))
    assert numbers[0] < sent[-1]


def test_a_camera_that_comes_back_sends_on_where_nothing_can_be_recorded_any_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, said, plugged = tmp_path / "stick", list[str](), [SoftwareCamera(rig(SIZE))]
    monkeypatch.setattr(realsense, "cameras", lambda: [camera.device for camera in plugged])
    recorder = Recorder(folder / "walk.db3", said.append)
    opening = cli._opening(PROFILE, None, None, recorder)  # pyright: ignore[reportPrivateUsage]
    folder.mkdir()
    opening().close()
    shutil.rmtree(folder)
    for _ in range(2):
        plugged[:] = [SoftwareCamera(rig(SIZE))]
        source = opening()
        with filming(plugged[0]):
            while source.read() is None:
                pass
            source.close()
    assert len(said) == 1
    assert said[0].startswith(f"the recording is incomplete: {folder}/walk.db3 could not be begun (")
    assert recorder.incomplete is not None


def test_a_recording_in_another_format_is_refused_with_the_one_that_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match=r"must have \.db3 extension"):
        opened(SoftwareCamera(rig(SIZE)), record=tmp_path / "kept.bag")


@pytest.mark.parametrize("command", ["run", "check"])
def test_its_tables_are_made_before_the_first_image_is_asked_for(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[str]()

    class Source:
        name = "made up"

        @property
        def rig(self) -> Rig:
            asked.append("rig")
            return rig(SIZE)

        def read(self) -> Frame | None:
            asked.append("read")
            raise EndOfRecordingError

        def close(self) -> None:
            asked.append("close")

    @contextmanager
    def nobody(*_: object) -> Generator[None]:
        yield None

    def opening(*_: object) -> Callable[[], Source]:
        return Source

    def unheard(*_: object) -> None:
        """Ctrl-C stays the tests' own."""

    monkeypatch.setattr(cli, "_opening", opening)
    monkeypatch.setattr(feed, "publisher", nobody)
    monkeypatch.setattr(cli.signal, "signal", unheard)
    CliRunner().invoke(cli.app, [command, "--config", str(VEHICLE)])
    assert asked == ["rig", "read", "close"]
