"""A log is enough to run planner and controller again; a bit that is not as it was is found."""

from __future__ import annotations

import io
import json
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

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


def with_a_flip(
    flight: Path, out: Path, topic: str, flip: Callable[[bytes], bytes | None], *, ends: bool = False
) -> Path:
    """The log again, the payload in the middle of `topic` changed, or left out; with `ends` nothing comes after it."""
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
            if data is None:
                continue
            if ends and place > middle:
                break
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


@pytest.mark.parametrize(
    ("topic", "words"),
    [
        ("tel/control", "the answer of controller step"),
        ("tel/plan", "the plan"),
        ("tel/target", "the target after plan"),
    ],
)
def test_an_answer_that_a_log_lacks_is_named_and_is_no_success(
    flight: Path, tmp_path: Path, topic: str, words: str
) -> None:
    status, printed = replay(with_a_flip(flight, tmp_path / "without.mcap", topic, lambda _: None))
    assert status == 1, printed
    assert f"missing from the log: {words}" in printed


def test_an_image_that_a_log_lacks_is_named_and_all_others_are_answered_as_they_were(
    flight: Path, tmp_path: Path
) -> None:
    figures = tmp_path / "replay.json"
    log = with_a_flip(flight, tmp_path / "without.mcap", "log/rgbd", lambda _: None)
    status, printed = replay(log, "--policy", POLICY, "--json", figures)
    assert status == 1 and "missing from the log: the image of plan" in printed, printed
    network = json.loads(figures.read_text())["network"]
    assert network["same"] == network["of"] > 100


def test_a_frame_that_the_network_failed_on_is_seen_and_not_answered(flight: Path, tmp_path: Path) -> None:
    """The flight ends with such a frame: what the planner was given is there, without an answer and a plan."""

    def unanswered(data: bytes) -> bytes:
        message = goshawk_pb2.PlannerInput.FromString(data)
        del message.prediction[:]
        return message.SerializeToString()

    log = with_a_flip(flight, tmp_path / "failed.mcap", "log/planner_input", unanswered, ends=True)
    status, printed = replay(log)
    assert status == 0, printed
    assert "no difference" in printed


def test_an_input_that_lacks_a_part_is_named_and_the_rest_is_replayed(flight: Path, tmp_path: Path) -> None:
    def partly(data: bytes) -> bytes:
        message = goshawk_pb2.PlannerInput.FromString(data)
        message.ClearField("odometry")
        return message.SerializeToString()

    figures = tmp_path / "replay.json"
    log = with_a_flip(flight, tmp_path / "partly.mcap", "log/planner_input", partly)
    status, printed = replay(log, "--json", figures)
    assert status == 1, printed
    assert "missing from the log: a part of the input of plan" in printed
    whole = tmp_path / "whole.json"
    replay(flight, "--json", whole)
    of, before = (json.loads(path.read_text())["controls"]["of"] for path in (figures, whole))
    assert of == before, "every step is there yet"


def test_figures_are_never_written_over_the_log(flight: Path, tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    log.write_bytes(flight.read_bytes())
    status, _ = replay(log, "--json", log)
    assert status == 1
    assert log.read_bytes() == flight.read_bytes()


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
        rgb[48, 80, 0] ^= 128
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


def altered(flight: Path, folder: Path, *arguments: str | Path) -> tuple[dict[str, Any], list[goshawk_pb2.Plan]]:
    """What came of an alteration at 8 s for 2 s, and the plans that it wrote."""
    figures, out = folder / "altered.json", folder / "altered.mcap"
    status, printed = replay(flight, "--from", "8", "--for", "2", *arguments, "--json", figures, "--out", out)
    assert status == 0, printed
    found = json.loads(figures.read_text())
    assert found["words"] == printed.splitlines()[0]
    with out.open("rb") as stream:
        messages = make_reader(stream).iter_messages(topics=["tel/plan"])
        return found, [goshawk_pb2.Plan.FromString(message.data) for _, _, message in messages]


def flown_plans(flight: Path) -> dict[int, goshawk_pb2.Plan]:
    """By their numbers."""
    with flight.open("rb") as stream:
        messages = make_reader(stream).iter_messages(topics=["tel/plan"])
        plans = [goshawk_pb2.Plan.FromString(message.data) for _, _, message in messages]
    return {plan.seq: plan for plan in plans}


def test_with_the_flown_values_the_planner_goes_on_bit_for_bit(flight: Path, tmp_path: Path) -> None:
    found, plans = altered(flight, tmp_path, "--set", "planner.costs.obstacle=5", "--policy", POLICY)
    assert found["same"] == found["frames"] == len(plans) > 40
    assert found["first_other"] is None and found["first_difference"] is None
    assert "as well, and so in all" in found["words"]
    flown = flown_plans(flight)
    assert [plan.SerializeToString() for plan in plans] == [flown[plan.seq].SerializeToString() for plan in plans]
    assert found["from_s"] >= 8.0 and found["to_s"] <= 10.0


def test_a_parameter_altered_at_an_instant_changes_what_is_flown_from_there_on(flight: Path, tmp_path: Path) -> None:
    before = flight.read_bytes()
    change = "planner.chase.standoff_m = 8"
    found, plans = altered(flight, tmp_path, "--set", change, "--policy", POLICY)
    assert found["same"] < found["frames"] == len(plans)
    assert re.search(r"candidate \d+ instead of \d+", found["words"])
    flown, first = flown_plans(flight), found["first_other"]
    other = next(plan for plan in plans if plan.seq == first["seq"])
    assert (flown[first["seq"]].chosen, other.chosen) == (first["flown"], first["altered"])
    assert flight.read_bytes() == before


def test_what_cannot_be_altered_is_one_clear_line_and_nothing_is_written(flight: Path, tmp_path: Path) -> None:
    out = tmp_path / "altered.mcap"
    for arguments, says in (
        (["--set", "planner.costs.obstacle=-1"], "planner.costs.obstacle"),
        (["--set", "planner.costs.obstacles=1"], "unknown field `obstacles`"),
        (["--set", "planner.costs.obstacle=much"], "much is no value"),
        (["--set", "observer.alpha1=2"], "only the planner is altered"),
        (["--set", "planner.cost"], "write it as planner.KEY=VALUE"),
        (["--set", "planner.chase.standoff_m=8"], "name the policy that flew"),
        (["--policy", ROOT / "air/models/navigate.onnx"], "Navigate"),
        ([], "nothing is altered"),
        (["--from", "500", "--policy", POLICY], "holds no plan between 500.00 s"),
    ):
        instant = [] if "--from" in arguments else ["--from", "8"]
        status, printed = replay(flight, *instant, *arguments, "--out", out)
        assert status == 1, arguments
        (line,) = printed.strip().splitlines()
        assert says in line, line
        assert not out.exists()
