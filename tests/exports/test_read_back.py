"""Exports of a real flight, read back by the libraries of the tools that they are for."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from goshawk_dashboards.exports import Exported, ExportError, Format, export_log
from goshawk_dashboards.log.flight import Flight
from goshawk_proto import goshawk_pb2 as pb
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoder
from mcap_ros2.decoder import DecoderFactory as Ros2Decoder
from PIL import Image
from rerun.chunk import RrdReader

Exports = Callable[[Format], Exported]


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_csv_has_every_record_of_every_channel(flight: Flight, exported: Exports) -> None:
    done = exported(Format.CSV)
    assert {name: len(rows(done.path / name)) for name in done.counts} == done.counts
    control = rows(done.path / "tel_control.csv")
    columns = flight.columns("control", ["pos_world", "plan_age_s", "mode"])
    # The first steps come before the first odometry: no place, so an empty cell.
    east = np.array([float(row["pos_world.x"] or "nan") for row in control])
    assert np.array_equal(east, columns["pos_world"][:, 0], equal_nan=True)
    assert control[0]["pos_world.x"] == ""
    assert done.counts["log_imu.csv"] == flight.count("imu") > 500
    ages = np.array([float(row["plan_age_s"] or "nan") for row in control])
    assert np.array_equal(ages, columns["plan_age_s"], equal_nan=True)
    assert [row["mode"] for row in control] == [pb.Mode.Name(int(mode)) for mode in columns["mode"]]
    assert {"MODE_TAKEOFF", "MODE_TRACK"} < {row["mode"] for row in control}
    assert done.counts["tel_plan.candidates.csv"] == 15 * flight.count("plan")


def test_csv_images_lie_beside_their_table(flight: Flight, exported: Exports) -> None:
    folder = exported(Format.CSV).path
    images = rows(folder / "log_rgbd.csv")
    assert len(images) == flight.count("rgbd")
    last = flight.frame_at(flight.duration_s)
    assert last is not None
    assert (folder / images[-1]["rgb_png"]).read_bytes() == last.rgb_png
    assert Image.open(folder / images[-1]["depth_png"]).size == (last.width, last.height)


def decoded(done: Exported, decoder: Any) -> dict[str, list[Any]]:
    """An MCAP file's messages by topic."""
    found: dict[str, list[Any]] = {}
    with done.path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[decoder], validate_crcs=True)
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    return found


def test_foxglove_has_the_logs_own_channels_and_the_scene(flight: Flight, exported: Exports) -> None:
    done = exported(Format.FOXGLOVE)
    found = decoded(done, ProtobufDecoder())
    assert {topic: len(messages) for topic, messages in found.items()} == done.counts
    for topic in flight.log.topics:
        assert len(found[f"/{topic}"]) == len(flight.log.times_ns(topic))
    assert found["/tel/control"][100].SerializeToString() == flight.log.payload("tel/control", 100)
    plan = flight.plan_at(flight.duration_s)
    assert plan is not None and plan.chosen is not None
    candidates, chosen = found["/scene/plan"][-1].entities
    assert (len(candidates.lines), len(chosen.lines)) == (15, 1)
    end = chosen.lines[0].points[-1]
    assert np.allclose((end.x, end.y, end.z), plan.end_pos_world_N3[plan.chosen], atol=1e-4)


def test_foxglove_images_and_transforms_fit_together(flight: Flight, exported: Exports) -> None:
    found = decoded(exported(Format.FOXGLOVE), ProtobufDecoder())
    image, depth, lens = (found[f"/camera/{name}"][50] for name in ("image", "depth", "calibration"))
    frame = flight.frame_at(flight.times_s("rgbd")[50])
    assert frame is not None
    assert (image.data, image.format, image.frame_id) == (frame.rgb_png, "png", lens.frame_id)
    depth_m = frame.depth_m_HW()
    assert depth_m is not None
    assert np.array_equal(np.frombuffer(depth.data, "<u2").reshape(depth_m.shape), np.rint(1e3 * depth_m))
    edges = [(t.parent_frame_id, t.child_frame_id) for t in found["/tf_static"][0].transforms]
    assert edges == [("body", "camera"), ("camera", image.frame_id)]
    assert {(t.parent_frame_id, t.child_frame_id) for t in found["/tf"]} == {("world", "body")}


def test_ros2_messages_decode_by_their_own_schemas(flight: Flight, exported: Exports) -> None:
    done = exported(Format.ROS2)
    found = decoded(done, Ros2Decoder())
    assert {topic: len(messages) for topic, messages in found.items()} == done.counts
    odometry = flight.columns("odometry", ["pos_world", "vel_world"])
    assert len(found["/odometry"]) == len(odometry)
    last = found["/odometry"][-1]
    place = last.pose.pose.position
    assert (place.x, place.y, place.z) == tuple(odometry["pos_world"][-1])
    twist = last.twist.twist.linear
    assert np.hypot(np.hypot(twist.x, twist.y), twist.z) == pytest.approx(np.linalg.norm(odometry["vel_world"][-1]))
    felt = [found[f"/acceleration/{name}"][-1].accel.linear for name in ("measured", "true")]
    assert np.allclose(*([a.x, a.y, a.z] for a in felt), atol=2.0)
    assert len(found["/imu"]) == flight.count("imu")
    cloud, remembered = found["/remembered"][-1], flight.remembered_at(flight.duration_s)
    assert remembered is not None and cloud.width == len(remembered.cells_V3) > 0
    first = np.frombuffer(bytes(cloud.data), "<f4")[:3]
    assert np.allclose(first, remembered.origin_world_3 + remembered.centre_V3[0], atol=1e-3)
    info = found["/camera/camera_info"][0]
    assert info.k[2] == info.width / 2
    plan = flight.plan_at(flight.duration_s)
    assert plan is not None and plan.chosen is not None
    end = found["/plan/chosen"][-1].poses[-1].pose.position
    assert np.allclose((end.x, end.y, end.z), plan.end_pos_world_N3[plan.chosen], atol=1e-4)
    assert found["/rosout"][0].msg == flight.events[0].text


def test_ros2_twist_is_in_the_bodys_frame(flight: Flight, exported: Exports) -> None:
    done = exported(Format.ROS2)
    forward = [message.twist.twist.linear.x for message in decoded(done, Ros2Decoder())["/odometry"]]
    speed = np.linalg.norm(flight.columns("odometry", ["vel_world"])["vel_world"], axis=1)
    # It looks where it flies: nearly all of a fast chase's speed is forward.
    assert np.median(np.array(forward)[speed > 3.0] / speed[speed > 3.0]) > 0.9


def test_rerun_opens_with_its_blueprint(flight: Flight, exported: Exports) -> None:
    done = exported(Format.RERUN)
    reader = RrdReader(done.path)
    assert [entry.application_id for entry in reader.blueprints()] == ["goshawk"]
    chunks = list(reader.stream())
    counts: Counter[str] = Counter()
    for chunk in chunks:
        counts[chunk.entity_path.removeprefix("/")] += 0 if chunk.is_static else chunk.num_rows
    control, plan = len(flight.columns("control", ["seq"])), flight.count("plan")
    # A step before the first odometry has no attitude, and so no place.
    assert control - 5 <= counts["world/body"] <= control
    assert counts["world/body/camera/image"] == flight.count("rgbd")
    assert counts["world/plan/candidates"] == counts["world/plan/chosen"] == plan
    assert counts["events"] == len(flight.events)
    assert counts["world/remembered"] == flight.count("map") > 0
    assert counts["imu/specific_force"] == flight.count("imu")
    assert counts["acceleration/up/true"] == flight.count("sim_truth")
    assert control - 5 <= counts["acceleration/up/measured"] <= control


def test_rerun_keeps_the_vehicles_clock(flight: Flight, exported: Exports) -> None:
    done = exported(Format.RERUN)
    stamps: list[int] = []
    for chunk in RrdReader(done.path).stream():
        if chunk.entity_path == "/speed/total" and not chunk.is_static:
            batch = cast("Any", chunk.to_record_batch())
            stamps += [value.value for value in batch.column("vehicle")]
    assert max(stamps) == flight.log.times_ns("tel/control")[-1]


@pytest.mark.parametrize("format", list(Format))
def test_an_export_never_overwrites_and_leaves_nothing_half_done(
    flight: Flight, format: Format, tmp_path: Path
) -> None:
    output = tmp_path / "out"
    output.write_text("mine")
    with pytest.raises(ExportError, match="exists already"):
        export_log(flight, format, output)
    with pytest.raises(ExportError, match="cannot write"):
        export_log(flight, format, tmp_path / "nosuch" / "out")
    assert output.read_text() == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize("format", list(Format))
def test_a_log_that_was_cut_off_is_exported_as_far_as_it_goes(log: Path, format: Format, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    whole = log.read_bytes()
    cut.write_bytes(whole[: len(whole) // 2])
    flight = Flight.open(cut)
    assert not flight.closed
    done = export_log(flight, format, tmp_path / "out")
    assert sum(done.counts.values()) > flight.count("control") > 500
