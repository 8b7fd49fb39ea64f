"""A log is enough to run planner and controller again; a bit that is not as it was is found."""

from __future__ import annotations

import io
import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnx
import pytest
from goshawk_proto import goshawk_pb2
from mcap.reader import make_reader
from mcap.writer import Writer
from onnx import numpy_helper
from PIL import Image
from rig import BIN, ROOT

POLICY = ROOT / "air/models/track.onnx"


def replay(log: Path, *arguments: str | Path) -> tuple[int, str]:
    """Exit status and what it printed."""
    command = [str(BIN / "goshawk-air"), "replay", str(log), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return done.returncode, done.stdout + done.stderr


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of one short flight in lockstep."""
    folder = tmp_path_factory.mktemp("lockstep")
    command = [BIN / "goshawk-sim", "fly", "--task", "track", "--speed", "3", "--trials", "1", "--seed", "3",
               "--log", folder]  # fmt: skip
    subprocess.run([str(c) for c in command], check=True, capture_output=True, timeout=240, cwd=ROOT)
    (log,) = folder.glob("*.mcap")
    return log


def test_planner_controller_and_network_answer_as_they_did(flight: Path, tmp_path: Path) -> None:
    figures = tmp_path / "replay.json"
    status, printed = replay(flight, "--policy", POLICY, "--json", figures)
    assert status == 0, printed
    assert "no difference" in printed
    outcome = json.loads(figures.read_text())
    for part in ["plans", "targets", "controls", "network"]:
        assert outcome[part]["of"] == outcome[part]["same"] > 100, part


def with_a_flip(flight: Path, out: Path, topic: str, flip: Callable[[bytes], bytes]) -> Path:
    """The log again, the payload in the middle of `topic` changed."""
    with flight.open("rb") as source:
        messages = list(make_reader(source).iter_messages(log_time_order=False))
    places = [place for place, (_, channel, _) in enumerate(messages) if channel.topic == topic]
    middle = places[len(places) // 2]
    with out.open("wb") as sink:
        writer = Writer(sink)
        writer.start()
        channels: dict[str, int] = {}
        for place, (schema, channel, message) in enumerate(messages):
            assert schema is not None
            if channel.topic not in channels:
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            data = flip(message.data) if place == middle else message.data
            writer.add_message(channels[channel.topic], message.log_time, data, message.publish_time)
        writer.finish()
    return out


def velocity(data: bytes) -> bytes:
    message = goshawk_pb2.Odometry.FromString(data)
    message.vel_world.x += 2.0**-40
    return message.SerializeToString()


def speed(data: bytes) -> bytes:
    message = goshawk_pb2.PlannerInput.FromString(data)
    message.speed_mps += 2.0**-40
    return message.SerializeToString()


def prediction(data: bytes) -> bytes:
    message = goshawk_pb2.PlannerInput.FromString(data)
    message.prediction[0] += 2.0**-10
    return message.SerializeToString()


def landed(data: bytes) -> bytes:
    message = goshawk_pb2.ControllerInput.FromString(data)
    message.armed = not message.armed
    return message.SerializeToString()


@pytest.mark.parametrize(
    ("topic", "flip"),
    [
        ("log/odometry", velocity),
        ("log/planner_input", speed),
        ("log/planner_input", prediction),
        ("log/controller_input", landed),
    ],
)
def test_one_changed_input_is_found_with_its_time(
    flight: Path, tmp_path: Path, topic: str, flip: Callable[[bytes], bytes]
) -> None:
    status, printed = replay(with_a_flip(flight, tmp_path / "flipped.mcap", topic, flip))
    assert status == 1, printed
    assert "first difference at" in printed
    assert "no difference" not in printed


def test_a_log_of_another_protocol_is_refused_in_one_line(flight: Path, tmp_path: Path) -> None:
    def older(data: bytes) -> bytes:
        header = goshawk_pb2.LogHeader.FromString(data)
        header.protocol -= 1
        return header.SerializeToString()

    status, printed = replay(with_a_flip(flight, tmp_path / "older.mcap", "log/header", older))
    assert status == 1
    assert "protocol" in printed and len(printed.strip().splitlines()) == 1


def test_one_changed_pixel_is_found_by_the_network(flight: Path, tmp_path: Path) -> None:
    def brighter(data: bytes) -> bytes:
        message = goshawk_pb2.CompressedRgbd.FromString(data)
        rgb = np.asarray(Image.open(io.BytesIO(message.rgb_png))).copy()
        rgb[48, 80, 0] ^= 1
        png = io.BytesIO()
        Image.fromarray(rgb).save(png, "PNG")
        message.rgb_png = png.getvalue()
        return message.SerializeToString()

    log = with_a_flip(flight, tmp_path / "flipped.mcap", "log/rgbd", brighter)
    assert replay(log)[0] == 0, "planner and controller never saw the image itself"
    status, printed = replay(log, "--policy", POLICY)
    assert status == 1, printed
    assert "network's answer" in printed


def test_another_policy_is_compared_and_its_plans_are_written_at_the_same_stamps(flight: Path, tmp_path: Path) -> None:
    model = onnx.load(POLICY)
    bias = max(
        (t for t in model.graph.initializer if len(t.dims) == 1 and t.data_type == onnx.TensorProto.FLOAT),
        key=lambda t: t.dims[0],
    )
    bias.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(bias) * 1.3 + 0.05, bias.name))
    other, out = tmp_path / "other.onnx", tmp_path / "other.mcap"
    onnx.save(model, other)
    status, printed = replay(flight, "--policy", other, "-o", out)
    assert status == 0, printed
    assert "would have chosen" in printed

    def stamps(path: Path) -> list[tuple[int, int, int]]:
        with path.open("rb") as stream:
            reader = make_reader(stream)
            plans = [goshawk_pb2.Plan.FromString(m.data) for _, _, m in reader.iter_messages(topics=["tel/plan"])]
        return [(plan.seq, plan.frame_ns, plan.ready_ns) for plan in plans]

    assert stamps(out) == stamps(flight)
    again, said = replay(flight, "--policy", other, "-o", out)
    assert again == 1, "a log is never overwritten"
    assert len(said.strip().splitlines()) == 1


@pytest.mark.parametrize("kind", ["missing", "garbage", "navigate"])
def test_what_cannot_be_replayed_is_one_clear_line(flight: Path, tmp_path: Path, kind: str) -> None:
    path = tmp_path / "log.mcap"
    if kind == "garbage":
        path.write_bytes(bytes(range(256)))
    if kind == "navigate":
        status, printed = replay(flight, "--policy", ROOT / "air/models/navigate.onnx")
        assert "Navigate" in printed
    else:
        status, printed = replay(path)
        assert "log.mcap" in printed
    assert status == 1
    assert len(printed.strip().splitlines()) == 1
