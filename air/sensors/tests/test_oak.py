"""An OAK-D by a stand-in of depthai: what it is asked, what comes of its images, and what is said when it is gone."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import depthai_stand_in as dai
import msgspec
import numpy as np
import pytest
from goshawk_sensors.cameras import oak
from goshawk_sensors.setup import profile
from goshawk_sensors.setup.errors import CameraError, NoCameraError

SHIPPED = profile.load("oak-d")


@pytest.fixture(autouse=True)
def depthai(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """One camera is plugged in."""
    monkeypatch.setitem(sys.modules, "depthai", dai)
    dai.opened.clear()
    yield
    dai.Device.plugged = ("18443010",)


def nodes(kind: type) -> list[object]:
    pipeline = dai.opened[-1].pipeline
    assert pipeline is not None and pipeline.runs
    return [each for each in pipeline.nodes if isinstance(each, kind)]


def test_a_pair_has_the_size_of_the_profiles_colour_and_the_middle_of_its_exposure() -> None:
    camera = oak.open_live(SHIPPED, None)
    frame = camera.read()
    assert frame is not None and camera.name == "OAK-D 18443010"
    width, height = SHIPPED.colour.size
    assert (frame.colour_HW3.shape, frame.colour_HW3.dtype) == ((height, width, 3), np.uint8)
    assert (frame.depth_HW.shape, frame.depth_HW.dtype) == ((height, width), np.uint16)
    assert np.all(frame.colour_HW3 == 77) and np.all(frame.depth_HW == dai.DEPTH_MM)
    assert (frame.stamp.monotonic_ns, frame.number) == (5_040_000_000, 1)


def test_both_images_are_of_one_lens_without_distortion() -> None:
    rig = oak.open_live(SHIPPED, None).rig
    assert rig.colour is rig.depth and not rig.colour.distorted
    assert (rig.colour.width, rig.colour.height) == SHIPPED.colour.size
    assert (rig.colour.fx, rig.colour.cx, rig.colour.cy) == (dai.FOCAL_PX, *dai.CENTRE_PX)
    assert np.array_equal(rig.rotation_33, np.eye(3)) and not rig.translation_3.any()
    undistorted = {each.socket.name: each.undistorted for each in nodes(dai.Camera) if isinstance(each, dai.Camera)}
    assert undistorted == {"CAM_A": True, "CAM_B": False, "CAM_C": False}


def test_exposures_are_set_as_the_profile_says() -> None:
    fixed = msgspec.structs.replace(
        SHIPPED, colour=msgspec.structs.replace(SHIPPED.colour, auto_exposure=False, exposure_us=8000)
    )
    oak.open_live(fixed, None)
    said = {each.socket.name: each.initialControl.said for each in nodes(dai.Camera) if isinstance(each, dai.Camera)}
    assert said == {"CAM_A": [("manual", 8000, 400)], "CAM_B": [("automatic",)], "CAM_C": [("automatic",)]}


def test_the_id_chooses_among_several_and_none_is_no_camera() -> None:
    dai.Device.plugged = ("1", "2")
    assert oak.open_live(SHIPPED, "2").name == "OAK-D 2"
    with pytest.raises(NoCameraError, match=r"no OAK-D answers \(Cannot find any device .*\): see its cable"):
        oak.open_live(SHIPPED, "3")
    dai.Device.plugged = ()
    with pytest.raises(NoCameraError, match=r"no OAK-D answers \(No available devices\)"):
        oak.open_live(SHIPPED, None)


def test_a_moments_silence_is_none_and_a_long_one_is_no_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = oak.open_live(SHIPPED, None)
    dai.opened[-1].silent = True
    assert camera.read() is None
    monkeypatch.setattr(oak, "SILENT_S", 0.0)
    with pytest.raises(NoCameraError, match="OAK-D 18443010 is silent"):
        camera.read()


def test_one_that_is_pulled_out_is_gone_and_closes_twice() -> None:
    camera = oak.open_live(SHIPPED, None)
    dai.opened[-1].closed = True
    with pytest.raises(NoCameraError, match="OAK-D 18443010 is gone"):
        camera.read()
    camera.close()
    camera.close()


def test_a_closed_one_is_let_go_so_that_it_can_be_opened_again() -> None:
    oak.open_live(SHIPPED, None).close()
    assert dai.opened[-1].closed


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"align": "depth"}, 'say align = "colour"'),
        ({"depth": msgspec.structs.replace(SHIPPED.depth, emitter=True)}, "preset and emitter are a RealSense's"),
    ],
)
def test_what_only_a_realsense_can_is_refused(changes: dict[str, object], said: str) -> None:
    with pytest.raises(CameraError, match=said):
        oak.open_live(msgspec.structs.replace(SHIPPED, **changes), None)
