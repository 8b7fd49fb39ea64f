"""An export leaves out the field that makes no sense, and a failure says what is wrong and leaves nothing behind."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.exports import Exported, ExportError, Format, export_log
from goshawk_dashboards.log.flight import Flight
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from mcap.reader import make_reader


def flight(path: Path, *frames: pb.CompressedRgbd) -> Flight:
    """A log of the frames, each with an IMU's record of the same stamp."""
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL))
    for k, frame in enumerate(frames):
        log.write("rgbd", rec.START_NS + k, frame)
        log.write("imu", rec.START_NS + k, pb.Imu(stamp_ns=frame.stamp_ns))
    log.close()
    return Flight.open(path)


def frame(seq: int) -> pb.CompressedRgbd:
    return rec.frame(0.1 * seq, seq, np.random.default_rng(1))


@pytest.mark.parametrize("fov_rad", [0.0, -1.0, math.pi, math.nan])
@pytest.mark.parametrize("field", ["hfov_rad", "vfov_rad"])
@pytest.mark.parametrize(
    ("format", "topic"),
    [(Format.FOXGLOVE, "/camera/calibration"), (Format.ROS2, "/camera/camera_info")],
)
def test_a_frame_without_a_field_of_view_costs_its_calibration_only(
    format: Format, topic: str, field: str, fov_rad: float, tmp_path: Path
) -> None:
    odd = frame(1)
    setattr(odd, field, fov_rad)
    done = export_log(flight(tmp_path / "odd.mcap", odd, frame(2)), format, tmp_path / "out.mcap")
    assert done.counts[topic] == 1
    assert sum(n for name, n in done.counts.items() if name.startswith("/camera/image")) == 2


def test_ros_2_leaves_out_what_is_later_than_its_clock_tells(tmp_path: Path) -> None:
    last, late = frame(1), frame(2)
    last.stamp_ns, late.stamp_ns = 2**31 * 10**9 - 1, 2**31 * 10**9
    done = export_log(flight(tmp_path / "late.mcap", last, late, frame(3)), Format.ROS2, tmp_path / "out.mcap")
    assert (done.counts["/imu"], done.counts["/camera/camera_info"]) == (2, 2)
    assert read(done) == sum(done.counts.values())


def read(done: Exported) -> int:
    with done.path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())


@pytest.mark.parametrize("format", [Format.CSV, Format.FOXGLOVE, Format.ROS2])
def test_an_export_into_what_is_no_folder_is_refused_in_one_line(format: Format, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(ExportError, match=r"cannot write .*file/out: Not a directory"):
        export_log(flight(tmp_path / "flight.mcap", frame(1)), format, tmp_path / "file" / "out")
