"""The simulator's interfaces for real firmware, spoken to by two small firmwares that share nothing with it."""

from __future__ import annotations

import json
import math
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from firmware import ArduPilot, Px4, SelfSimulated, Wish, motors
from goshawk_proto import goshawk_pb2 as pb
from goshawk_proto.keys import key_expression

ROOT = Path(__file__).resolve().parents[2]
SIM = ROOT / "target/release/goshawk-sim"
EAST = math.pi / 2
SAMPLE_US = 4000


class World:
    """`goshawk-sim serve` with firmware awaited on a port of its own."""

    def __init__(self, autopilot: str, *arguments: str) -> None:
        self.endpoint = free_endpoint()
        command = [SIM, "serve", "--autopilot", autopilot, "--connect", self.endpoint]
        if autopilot != "external":
            command += ["--firmware-at", "127.0.0.1:0"]
        self.process = subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True, cwd=ROOT)
        if autopilot != "external":
            self.port = int(self.line(r"awaited at (?:TCP|UDP) 127\.0\.0\.1:(\d+)").group(1))

    def line(self, pattern: str) -> re.Match[str]:
        """The next line of its output that fits."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if found := re.search(pattern, line):
                return found
        raise AssertionError(f"it ended without {pattern!r}")

    def close(self) -> None:
        self.process.terminate()
        assert self.process.wait(timeout=20) == 0


def free_endpoint() -> str:
    """A Zenoh endpoint at which nobody listens: the simulator keeps dialling."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def world() -> Iterator[Callable[..., World]]:
    """Starts a world, and ends it."""
    started: list[World] = []

    def start(*arguments: str) -> World:
        started.append(World(*arguments))
        return started[-1]

    yield start
    for one in started:
        one.close()


def test_at_rest_px4_measures_gravity_the_field_the_air_and_its_place(world: Callable[..., World]) -> None:
    px4 = Px4(world("px4").port)
    samples: list[dict[str, Any]] = [px4.sample() for _ in range(200)]
    sensors = [found["HIL_SENSOR"] for found in samples]
    stamps = np.diff([s.time_usec for s in sensors])
    assert set(stamps) == {SAMPLE_US}
    assert all(s.id == 0 and s.fields_updated & 0x3F == 0x3F for s in sensors)
    updates = [sum(s.fields_updated & bit == bit for s in sensors) for bit in (0x1C0, 0x1A00)]
    assert updates[0] in (66, 67) and updates[1] == 40, "80 Hz of field, 50 Hz of air"
    standing = px4.motion(next(found for found in reversed(samples) if "HIL_STATE_QUATERNION" in found))
    sensors = sensors[-40:]  # by then it has settled onto the slope of the ground
    force = standing.in_ned(np.mean([(s.xacc, s.yacc, s.zacc) for s in sensors], axis=0))
    assert np.linalg.norm(force - (0, 0, -9.81)) < 0.3, force
    field = standing.in_ned(np.mean([(s.xmag, s.ymag, s.zmag) for s in sensors], axis=0))
    assert np.linalg.norm(field) == pytest.approx(0.483, abs=0.005)
    declination = math.degrees(math.atan2(field[1], field[0]))
    dip = math.degrees(math.atan2(field[2], math.hypot(field[0], field[1])))
    assert declination == pytest.approx(3.3, abs=0.5) and dip == pytest.approx(63.2, abs=0.5)
    assert standing.euler[2] == pytest.approx(EAST, abs=0.1), "it stands facing east"
    assert np.mean([s.abs_pressure for s in sensors]) == pytest.approx(956.0, abs=0.5)
    fixes = [found["HIL_GPS"] for found in samples if "HIL_GPS" in found]
    assert len(fixes) >= 6 and all(fix.fix_type == 3 for fix in fixes)
    state = next(found for found in reversed(samples) if "HIL_STATE_QUATERNION" in found)["HIL_STATE_QUATERNION"]
    for fix in fixes:
        assert (fix.lat - state.lat) * 1e-7 == pytest.approx(0, abs=1e-5)
        assert (fix.lon - state.lon) * 1e-7 == pytest.approx(0, abs=1e-5)
        assert (fix.alt - state.alt) * 1e-3 == pytest.approx(0, abs=1.0)


def test_physics_waits_for_px4_and_no_sample_is_left_out(world: Callable[..., World]) -> None:
    px4 = Px4(world("px4").port)
    before = px4.sample()["HIL_SENSOR"].time_usec
    px4.control(before, [0.05] * 4)
    while True:  # those that were on their way before physics heard of the commands
        stamp = px4.sample()["HIL_SENSOR"].time_usec
        assert stamp == before + SAMPLE_US
        before = stamp
        px4.socket.settimeout(0.3)
        try:
            px4.waiting.append(px4.receive())
        except TimeoutError:
            break
    for _ in range(200):
        px4.control(before, [0.05] * 4)
        stamp = px4.sample()["HIL_SENSOR"].time_usec
        assert stamp == before + SAMPLE_US
        before = stamp


def fly_px4(px4: Px4, wish: Wish, samples: int) -> dict[str, Any]:
    """Flies for so many samples, and gives the last."""
    found = px4.sample()
    for _ in range(samples):
        motion = px4.motion(found)
        px4.control(found["HIL_SENSOR"].time_usec, motors(motion, wish))
        found = px4.sample()
    px4.control(found["HIL_SENSOR"].time_usec, motors(px4.motion(found), wish))
    return found


def test_px4s_rotors_lift_turn_and_tilt_the_vehicle_as_their_places_say(world: Callable[..., World]) -> None:
    served = world("px4")
    px4 = Px4(served.port)
    px4.control(px4.sample()["HIL_SENSOR"].time_usec, None)
    hovering = fly_px4(px4, Wish(height_m=2.0, yaw=EAST), 1000)
    served.line("PX4 has armed")
    assert -px4.motion(hovering).down_m == pytest.approx(2.0, abs=0.3)
    turned = fly_px4(px4, Wish(height_m=2.0, yaw=EAST + 1.0), 750)
    assert px4.motion(turned).euler[2] == pytest.approx(EAST + 1.0, abs=0.1), "clockwise, seen from above"
    back = fly_px4(px4, Wish(height_m=2.0, yaw=EAST), 750)
    start = px4.place(back)
    # Facing east, ahead is east and to the right is south.
    ahead = px4.place(fly_px4(px4, Wish(height_m=2.0, pitch=-0.15, yaw=EAST), 250)) - start
    assert ahead[1] > 0.3 > abs(ahead[0]), ahead
    right = px4.place(fly_px4(px4, Wish(height_m=2.0, roll=0.2, yaw=EAST), 300)) - start
    assert right[0] < -0.3, right


def test_px4_may_hang_up_talk_nonsense_and_come_again(world: Callable[..., World]) -> None:
    served = world("px4")
    px4 = Px4(served.port)
    px4.sample()
    px4.socket.close()
    served.line("PX4 has gone")
    again = Px4(served.port)
    again.sample()
    again.socket.sendall(b"\xfd\xff" * 5000)  # no frame is in it; it is passed over
    hovering = fly_px4(again, Wish(height_m=1.0, yaw=EAST), 500)
    served.line("PX4 has armed")
    assert -again.motion(hovering).down_m > 0.5


def test_ardupilots_motors_lift_and_turn_the_vehicle_in_lockstep(world: Callable[..., World]) -> None:
    served = world("ardupilot", "--vehicle-file", "air/vehicles/ardupilot-sitl.toml")
    copter = ArduPilot(served.port)
    answer = copter.step([0.0] * 4)
    assert np.linalg.norm(np.array(answer["imu"]["accel_body"]) - (0, 0, -9.81)) < 0.5
    assert answer["attitude"] == pytest.approx(copter.motion(answer).euler, abs=1e-9)
    copter.step([0.0] * 4, again=True)  # an answer that was lost is given again
    wish = Wish(height_m=2.0, yaw=EAST)
    stamps: list[float] = []
    for k in range(3500):
        if k == 2000:
            wish = Wish(height_m=2.0, yaw=EAST + 1.0)
            assert -copter.motion(answer).down_m == pytest.approx(2.0, abs=0.3)
        answer = copter.step(motors(copter.motion(answer), wish))
        stamps.append(answer["timestamp"])
    assert np.diff(stamps) == pytest.approx(1 / copter.rate_hz, abs=1e-9)
    assert copter.motion(answer).euler[2] == pytest.approx(EAST + 1.0, abs=0.1)


def campaign(folder: Path, environment: str = "") -> list[str | Path]:
    """The command that flies one navigation by a small PX4, whose build is put into ``folder``."""
    program = folder / "build/bin/px4"
    program.parent.mkdir(parents=True)
    here = Path(__file__).parent
    program.write_text(f'#!/bin/sh\nPYTHONPATH={here} {environment} exec {sys.executable} -m small_px4 "$@"\n')
    program.chmod(0o755)
    command = [SIM, "fly", "--task", "navigate", "--speed", "3", "--trials", "1", "--spacing", "8", "--length", "20"]
    return [*command, "--autopilot", "px4", "--firmware", folder / "build", "--json", folder / "flown.json"]


def test_a_small_campaign_is_flown_by_firmware_that_is_started_from_its_build(tmp_path: Path) -> None:
    subprocess.run(campaign(tmp_path), check=True, cwd=ROOT, timeout=300)
    (cell,) = json.loads((tmp_path / "flown.json").read_text())["cells"]
    assert cell["successes"] == 1, cell


def test_firmware_that_dies_in_the_air_is_no_failure_of_the_policy(tmp_path: Path) -> None:
    command = campaign(tmp_path, "DIES_ABOVE_M=1")
    ended = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=300)
    assert ended.returncode != 0 and not (tmp_path / "flown.json").exists()
    assert "the firmware has ended" in ended.stderr and "hard fault in the mixer" in ended.stderr


def test_firmware_that_ends_before_it_connects_ends_the_simulator_with_its_last_words(tmp_path: Path) -> None:
    program = tmp_path / "bin/px4"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho another instance has the place\nexit 3\n")
    program.chmod(0o755)
    command = [SIM, "serve", "--autopilot", "px4", "--firmware", tmp_path]
    ended = subprocess.run(
        [*command, "--connect", free_endpoint()], capture_output=True, text=True, cwd=ROOT, timeout=60
    )
    assert ended.returncode != 0
    (line,) = ended.stderr.strip().splitlines()[-1:]
    assert "another instance has the place" in line and "it never connected" in line, ended.stderr


def test_the_world_and_its_truth_follow_firmware_that_simulates_itself(world: Callable[..., World]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    served = world("external", "--pose", f"udpin:127.0.0.1:{port}")
    served.line("waiting for the firmware's pose")
    seen: list[pb.SimTruth] = []
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([served.endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    firmware = SelfSimulated(port)
    try:
        with zenoh.open(config) as session:
            key = key_expression("sim_truth", "goshawk")
            session.declare_subscriber(key, lambda sample: seen.append(pb.SimTruth.FromString(bytes(sample.payload))))
            deadline = time.monotonic() + 60
            while not (seen and seen[-1].pos_world.y > 2.0):
                assert time.monotonic() < deadline, "the truth did not follow"
                time.sleep(0.02)
            lag = firmware.now() - 1.0 - seen[-1].pos_world.y
    finally:
        firmware.close()
    # In the vehicle's own frame, east-north-up, its way is north and the target is ahead of it.
    last = seen[-1]
    assert abs(last.pos_world.x) < 0.1 and last.pos_world.z == pytest.approx(1.0, abs=0.1)
    assert -0.3 < lag < 1.0, lag
    assert last.vel_world.y == pytest.approx(1.0, abs=0.05)
    assert last.target_pos_world.y > 3 * abs(last.target_pos_world.x)
    served.line("pose has stopped: the vehicle stands")


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--autopilot", "ardupilot"], r"firmware is PX4: give --vehicle-file"),
        (["--autopilot", "px4", "--mishap", "deaf"], "are for the stand-in"),
        (["--firmware-at", "127.0.0.1:4560"], "are for --autopilot px4 or ardupilot"),
        (["--autopilot", "px4", "--firmware-at", "here"], "invalid value 'here'"),
        (["--autopilot", "external"], "belong together"),
        (["--autopilot", "external", "--pose", "14550"], "invalid value '14550'"),
    ],
)
def test_what_does_not_fit_the_firmware_is_one_clear_line(arguments: list[str], told: str) -> None:
    ended = subprocess.run([SIM, "serve", *arguments], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert ended.returncode != 0
    assert re.search(told, ended.stderr), ended.stderr


def test_a_port_in_use_is_named_with_the_way_out() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        at = f"127.0.0.1:{taken.getsockname()[1]}"
        command = [SIM, "serve", "--autopilot", "px4", "--firmware-at", at]
        ended = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert ended.returncode != 0 and f"{at} is in use" in ended.stderr
