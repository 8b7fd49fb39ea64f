"""A recording through the real process into a real Zenoh session: pixels, stamps, rate, and each error's one line."""

from __future__ import annotations

import json
import re
import signal
import socket
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import zenoh
from camera_process import PLUGGED, ROOT, SHOTS, VEHICLE, X500, camera, colour_of, running
from goshawk_proto import goshawk_pb2, key_expression
from goshawk_sensors.cameras import realsense
from goshawk_sensors.cli import LEAST_RATE
from goshawk_sensors.setup import profile
from goshawk_sensors.setup.errors import CameraError, EndOfRecordingError
from goshawk_sensors.setup.vehicle import endpoint, load
from lenses import d435
from software_camera import Shot, SoftwareCamera

POLICY = (160, 96)
FIRST_S = 20.0


@dataclass(kw_only=True)
class Heard:
    """A vehicle's ear: a session that listens, and what came."""

    endpoint: str
    images: list[tuple[int, goshawk_pb2.Rgbd]] = field(default_factory=list[tuple[int, goshawk_pb2.Rgbd]])
    """When each came, CLOCK_MONOTONIC, ns."""

    def wait_for(self, count: int) -> None:
        ending_s = time.monotonic() + FIRST_S
        while len(self.images) < count and time.monotonic() < ending_s:
            time.sleep(0.02)
        assert len(self.images) >= count


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def listening(endpoint: str) -> Generator[Heard]:
    heard, config = Heard(endpoint=endpoint), zenoh.Config()
    for key, value in {
        "mode": "peer", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False,
    }.items():  # fmt: skip
        config.insert_json5(key, json.dumps(value))

    def take(sample: zenoh.Sample) -> None:
        heard.images.append((time.monotonic_ns(), goshawk_pb2.Rgbd.FromString(sample.payload.to_bytes())))

    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(key_expression("rgbd", "goshawk"), take)
        yield heard
        subscriber.undeclare()


@pytest.fixture
def vehicle() -> Iterator[Heard]:
    with listening(free_endpoint()) as heard:
        yield heard


def pixels(message: goshawk_pb2.Rgbd) -> tuple[np.ndarray, np.ndarray]:
    colour = np.frombuffer(message.rgb, np.uint8).reshape(message.height, message.width, 3)
    return colour, np.frombuffer(message.depth_mm, "<u2").reshape(message.height, message.width)


def test_a_recordings_images_arrive_as_the_policy_wants_them(recording: Path, vehicle: Heard) -> None:
    done = camera("run", "--config", VEHICLE, "--play", recording, "--connect", vehicle.endpoint)
    assert done.returncode == 0, done.stderr
    told = re.search(r", (\d+) lost, .*\n(\d+) images sent", done.stdout)
    assert told is not None, done.stdout
    lost, sent = int(told[1]), int(told[2])
    # librealsense may begin a pair late, and leaves out what a busy machine takes too late.
    assert SHOTS - 3 <= sent + lost <= SHOTS and sent > SHOTS / 2
    vehicle.wait_for(sent)
    for _, message in vehicle.images:
        assert (message.width, message.height) == POLICY
        assert np.degrees([message.hfov_rad, message.vfov_rad]) == pytest.approx([90.0, 61.93], abs=0.01)
        colour, depth = pixels(message)
        k = int(colour[0, 0, 0])
        assert np.array_equal(colour, colour_of(k)[::2, ::2])
        assert set(np.unique(depth).tolist()) == {0, 2000, 6000}
        assert (depth[10:30, 100:140] == 0).mean() > 0.95
    counts = [int(pixels(message)[0][0, 0, 0]) for _, message in vehicle.images]
    assert counts == sorted(set(counts))
    assert [message.seq for _, message in vehicle.images] == list(range(1, len(counts) + 1))


def test_the_stamps_are_of_this_hosts_monotonic_clock_and_as_far_apart_as_the_images_were_taken(
    recording: Path, vehicle: Heard
) -> None:
    camera("run", "--config", VEHICLE, "--play", recording, "--connect", vehicle.endpoint)
    came = np.array([ns for ns, _ in vehicle.images])
    stamps = np.array([message.stamp_ns for _, message in vehicle.images])
    assert len(stamps) > SHOTS / 2
    assert (stamps < came).all()
    assert (came - stamps < 500e6).all()
    assert np.median(np.diff(stamps)) == pytest.approx(1e9 / 30, rel=0.02)


def test_a_loop_goes_on_and_ctrl_c_ends_it_in_order(recording: Path, vehicle: Heard) -> None:
    with running("run", "--config", VEHICLE, "--play", recording, "--loop", "--connect", vehicle.endpoint) as process:
        vehicle.wait_for(2 * SHOTS)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    assert "images sent" in out
    stamps = [message.stamp_ns for _, message in vehicle.images]
    assert stamps == sorted(stamps)


def test_a_vehicle_that_starts_later_is_dialled_until_it_answers(recording: Path) -> None:
    endpoint = free_endpoint()
    with running("run", "--config", VEHICLE, "--play", recording, "--loop", "--connect", endpoint) as process:
        assert process.stderr is not None
        assert f"nothing answers at {endpoint}" in process.stderr.readline()
        with listening(endpoint) as heard:
            heard.wait_for(SHOTS // 2)


def test_a_check_says_what_the_camera_is_worth(recording: Path) -> None:
    done = camera("check", "--config", VEHICLE, "--play", recording, "--seconds", "0.5")
    said = {line[:14].strip(): line[14:] for line in done.stdout.splitlines()}
    assert list(said) == ["camera", "view", "rate", "lost", "latency", "depth", "stamp"]
    assert said["view"] == "160 x 96 pixels, 90.0 x 61.9 degrees"
    assert said["stamp"] == "the recording's, as if taken now"
    # A machine that is busy loses images, and the camera is worth less.
    fit = float(said["rate"].split()[0]) >= LEAST_RATE * 30.0
    assert (done.returncode, "Hz are too few" in done.stderr) == ((0, False) if fit else (1, True)), done.stderr


def test_a_bag_of_an_older_librealsense_plays_too(vehicle: Heard) -> None:
    bag = ROOT / "tests/data/realsense-2.57.bag"
    done = camera("run", "--config", VEHICLE, "--play", bag, "--connect", vehicle.endpoint)
    assert done.returncode == 0, done.stderr
    assert len(vehicle.images) > 3  # of twelve: a busy machine takes some too late
    for _, message in vehicle.images:
        colour, depth = pixels(message)
        assert (colour == (10, 20, 30)).all()
        assert set(np.unique(depth).tolist()) == {0, 2500}
        assert (depth == 2500).mean() > 0.2


def test_with_an_identity_the_vehicles_socket_is_found_in_its_file(recording: Path, tmp_path: Path) -> None:
    socket_name, config = f"unixsock-stream/{tmp_path}/sensors.sock", tmp_path / "vehicle.toml"
    text = VEHICLE.read_text().replace("../models", str(ROOT / "air/models"))
    config.write_text(text.replace("listen = [", f'listen = ["tls/0.0.0.0:7447", "{socket_name}", '))
    with listening(socket_name) as heard:
        assert camera("run", "--config", config, "--play", recording).returncode == 0
    assert len(heard.images) > SHOTS / 2


@pytest.mark.parametrize(
    ("listen", "dialled"),
    [
        (["tcp/127.0.0.1:7447"], "tcp/127.0.0.1:7447"),
        (["tls/0.0.0.0:7448", "tcp/0.0.0.0:7447"], "tcp/127.0.0.1:7447"),
        (["tcp/[::]:7447"], "tcp/[::1]:7447"),
        (["tcp/127.0.0.1:7447", "unixsock-stream//run/s.sock"], "unixsock-stream//run/s.sock"),
    ],
)
def test_a_sensor_dials_what_the_vehicle_listens_on_for_it(listen: list[str], dialled: str) -> None:
    assert endpoint(listen) == dialled


def test_every_command_and_option_that_the_page_shows_exists() -> None:
    page = (ROOT / "docs/how-to/camera.md").read_text()
    calls = re.findall(r"goshawk-camera (\w+)( [^`\n]*)", page)
    shown = {(command, *re.findall(r"--[a-z]+", rest)) for command, rest in calls}
    assert len(shown) >= 3
    for command, *options in shown:
        text = camera(command, "--help").stdout
        assert [option for option in options if option not in text] == [], command


def refused(*arguments: str | Path) -> str:
    """The one line with which the process ends."""
    done = camera(*arguments)
    assert done.returncode == 1, done.stdout + done.stderr
    (line,) = done.stderr.strip().splitlines()
    return line


@pytest.fixture(scope="module")
def d435_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    shot = Shot(
        colour_HW3=np.zeros((480, 848, 3), np.uint8), depth_HW=np.full((480, 848), 3000, np.uint16),
        wall_ms=time.time() * 1000.0,
    )  # fmt: skip
    return SoftwareCamera(d435()).record(tmp_path_factory.mktemp("d435") / "d435.db3", [shot] * 10)


def test_the_x500s_d435_sends_the_view_that_the_policy_wants_and_says_how_much_of_it_it_sees(
    d435_recording: Path,
) -> None:
    done = camera("check", "--config", X500, "--play", d435_recording, "--profile", "d435")
    line = "view          160 x 96 pixels, 90.0 x 61.9 degrees, depth sees 87% of it, colour 44%"
    assert line in done.stdout.splitlines(), done.stdout + done.stderr


def test_without_a_rim_a_camera_that_sees_too_little_is_refused_with_both_figures(
    d435_recording: Path, tmp_path: Path
) -> None:
    shipped = (ROOT / "air/sensors/goshawk_sensors/profiles/d435.toml").read_text()
    strict = tmp_path / "strict.toml"
    strict.write_text(shipped.replace("rim = true", "rim = false"))
    line = refused("check", "--config", X500, "--play", d435_recording, "--profile", strict)
    assert "colour sees 69.0 degrees from left to right, the policy wants 90.0" in line
    assert "rim = true" in line
    strict.write_text(shipped.replace('align = "colour"', 'align = "depth"'))
    assert 'rim = true is for align = "colour"' in refused(
        "check", "--config", X500, "--play", d435_recording, "--profile", strict
    )


def test_a_damaged_and_a_missing_recording_are_one_line(recording: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.db3"
    cut.write_bytes(recording.read_bytes()[: recording.stat().st_size // 3])
    assert "cannot be played" in refused("run", "--config", VEHICLE, "--play", cut, "--connect", "tcp/127.0.0.1:1")
    line = refused("check", "--config", VEHICLE, "--play", tmp_path / "none.db3")
    assert line == f"goshawk-camera: no recording {tmp_path / 'none.db3'}"


def test_a_vehicle_file_or_a_policy_that_is_not_there_is_one_line(recording: Path, tmp_path: Path) -> None:
    config = tmp_path / "vehicle.toml"
    assert f"vehicle file {config}: " in refused("check", "--config", config, "--play", recording)
    config.write_text('name = "goshawk"\n')
    assert "missing required field `policy`" in refused("check", "--config", config, "--play", recording)
    config.write_text('name = "goshawk"\npolicy.model = 3\nnetwork.listen = []\n')
    assert "`int` - at `$.policy.model`" in refused("check", "--config", config, "--play", recording)
    config.write_text(VEHICLE.read_text())  # beside which there is no ../models
    assert "track.onnx is not there" in refused("check", "--config", config, "--play", recording)


@pytest.mark.parametrize(
    ("dialled", "said"),
    [
        ("nope", "'nope' is not an endpoint"),
        ("", "'' is not an endpoint"),
        ("tcp/127.0.0.1", "with a port from 1 to 65535"),
        ("tcp/127.0.0.1:99999", "with a port from 1 to 65535"),
        ("tcp/[::1:7447", "with a port from 1 to 65535"),
        ("tcp/a..b:7447", "names no host: dial tcp/127.0.0.1:7447"),
        ("tcp/vehicle.invalid:7447", "names a host that is not known"),
        ("tls/127.0.0.1:7447", "a camera has none: leave out --connect"),
        ("tls/127.0.0.1:7447#root_ca_certificate=/none.pem", "a camera has none: leave out --connect"),
        (f"unixsock-stream/{'s' * 120}", "a socket's name has at most 107 bytes"),
    ],
)
def test_an_address_that_nobody_can_ever_answer_is_one_line(recording: Path, dialled: str, said: str) -> None:
    assert said in refused("run", "--config", VEHICLE, "--play", recording, "--connect", dialled)


def test_an_address_of_the_vehicle_file_that_nobody_can_answer_is_one_line(recording: Path, tmp_path: Path) -> None:
    config = tmp_path / "vehicle.toml"
    text = VEHICLE.read_text().replace("../models", str(ROOT / "air/models"))
    config.write_text(re.sub(r"^listen = .*$", 'listen = ["tcp/127.0.0.1:744700"]', text, flags=re.MULTILINE))
    assert "with a port from 1 to 65535" in refused("run", "--config", config, "--play", recording)


def test_a_name_with_a_nul_character_is_one_line_that_shows_it(tmp_path: Path) -> None:
    with pytest.raises(CameraError, match=r"the profile's name 'd4\\x0055' has a NUL character"):
        profile.load("d4\x0055")
    with pytest.raises(CameraError, match=r"vehicle file's name 'a\\x00b' has a NUL character"):
        load(Path("a\0b"))
    config, text = tmp_path / "vehicle.toml", VEHICLE.read_text()
    config.write_text(re.sub(r"^model = .*$", r'model = "track\\u0000.onnx"', text, flags=re.MULTILINE))
    assert r"the policy's name 'track\x00.onnx' has a NUL character" in refused("check", "--config", config)
    config.write_text(
        re.sub(r"^listen = .*$", r'listen = ["unixsock-stream//run/s\\u0000"]', text, flags=re.MULTILINE).replace(
            "../models", str(ROOT / "air/models")
        )
    )
    assert r"s\x00' has a NUL character" in refused("run", "--config", config)


NOISE = """
driver = "realsense"
rate_hz = 30
align = "depth"
latency_ms = 30.0
depth = { size = [320, 192], clip_m = [0.2, 12.0] }
colour = { size = [320, 192] }
"""


def test_a_full_disk_ends_the_recording_with_a_word_and_the_images_go_on(vehicle: Heard, tmp_path: Path) -> None:
    noise, file = tmp_path / "noise.toml", tmp_path / "walk.db3"
    noise.write_text(NOISE)
    with running(
        "run", "--config", VEHICLE, "--profile", noise, "--record", file, "--connect", vehicle.endpoint,
        command=PLUGGED, disk_bytes=3_000_000,
    ) as process:  # fmt: skip
        assert process.stderr is not None
        told = next(line for line in iter(process.stderr.readline, "") if "recording" in line)
        before = len(vehicle.images)
        vehicle.wait_for(before + 30)
        process.send_signal(signal.SIGINT)
        out, rest = process.communicate(timeout=20)
    assert re.fullmatch(
        rf"goshawk-camera: the recording is incomplete: {file} keeps the first \d+\.\d s \(Failed to write .*\)\. "
        r"Images are sent on\. Make room on its disk, and record anew\n",
        told,
    ), told
    assert process.returncode == 1
    assert "images sent" in out
    assert re.fullmatch(rf"goshawk-camera: the recording is incomplete: {file} keeps the first \d+\.\d s\n", rest), rest
    played, count = realsense.open_recording(file, profile.load(str(noise))), 0
    with pytest.raises(EndOfRecordingError):
        while True:
            count += played.read() is not None
    played.close()
    assert 0 < count < len(vehicle.images)


def test_a_recording_that_cannot_be_begun_is_one_line(tmp_path: Path) -> None:
    noise, file = tmp_path / "noise.toml", tmp_path / "none/walk.db3"
    noise.write_text(NOISE)
    for wait in ([], ["--wait"]):
        done = camera("run", "--config", VEHICLE, "--profile", noise, "--record", file, *wait, command=PLUGGED)
        assert done.returncode == 1, done.stderr
        (line,) = done.stderr.splitlines()
        assert line.startswith(f"goshawk-camera: the recording {file} cannot be written: ")
        assert line.endswith("see whether its folder is there and its disk has room")


def test_no_camera_is_one_line_that_says_where_to_look() -> None:
    assert "no RealSense is plugged in: see its cable" in refused("check", "--config", VEHICLE)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('align = "colour"', 'algin = "colour"', "algin"),
        ("clip_m = [0.4, 20.0]", "clip_m = [20.0, 0.4]", "clip_m is nearest, farthest"),
        ("emitter = true", "emitter = true\nlaser = 1", "laser"),
        ("auto_exposure = true", "auto_exposure = true\nexposure_us = 8000", "not both"),
        ("rate_hz = 30", "rate_hz = 1000", "rate_hz"),
    ],
)
def test_a_profile_with_a_wrong_key_or_value_is_one_line_that_names_it(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    text = (ROOT / "air/sensors/goshawk_sensors/profiles/d455.toml").read_text()
    file = tmp_path / "mine.toml"
    file.write_text(text.replace(old, new, 1))
    line = refused("check", "--config", VEHICLE, "--profile", file)
    assert line.startswith(f"goshawk-camera: profile {file}: ")
    assert said in line


def test_help_shows_an_example_and_needs_no_camera() -> None:
    done = camera("run", "--help")
    assert "goshawk-camera run --config vehicle.toml --profile d455" in done.stdout
