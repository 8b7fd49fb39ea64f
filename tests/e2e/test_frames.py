"""`goshawk-air check --frames`: a person's moves, the simulator's camera at that pose, and what is found."""

from __future__ import annotations

import json
import math
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hand_held import HandHeld
from rig import BIN, Rig, copied, free_port
from scipy.spatial.transform import Rotation

EAST = Rotation.from_euler("Z", 90, degrees=True)
LEVEL = EAST
PLACE = np.array([0.0, 0.0, -1.0])
# What is done when asked for the move of that name: position NED, attitude.
MOVES = {
    "lift its nose": (PLACE, LEVEL * Rotation.from_euler("Y", 20, degrees=True)),
    "lower its right side": (PLACE, LEVEL * Rotation.from_euler("X", 20, degrees=True)),
    "turn it to the left": (PLACE, LEVEL * Rotation.from_euler("Z", -90, degrees=True)),
    "lift it by": (np.array([0.0, 0.0, -1.7]), LEVEL),
    "carry it forward": (np.array([0.0, 0.7, -1.7]), LEVEL),
    "carry it to its left": (np.array([0.7, 0.7, -1.7]), LEVEL),
}


def vehicle(rig: Rig) -> Path:
    path = rig.folder / "alpha.toml"
    path.write_text(copied().replace('mounting = "simulated"', 'mounting = "checked"'))
    return path


class Checked:
    """The check, and a person who does what it says."""

    def __init__(self, rig: Rig, **mounted: Rotation) -> None:
        self.rig = rig
        pose = free_port()
        rig.spawn(
            "sim", BIN / "goshawk-sim", "serve", "--autopilot", "external", "--pose", f"udpin:127.0.0.1:{pose}",
            "--connect", rig.endpoint, "--seed", "5",
        )  # fmt: skip
        self.figures = rig.folder / "frames.json"
        command = [BIN / "goshawk-air", "check", "--frames", "--config", vehicle(rig), "--listen", rig.endpoint]
        command += ["--mavlink-bind", f"127.0.0.1:{rig.mavlink_port}", "--json", self.figures, "--wait", "30"]
        self.process = subprocess.Popen([str(c) for c in command], stdout=subprocess.PIPE, text=True)
        self.hand = HandHeld(rig.mavlink_port, pose, **mounted)
        self.hand.way = ((PLACE, LEVEL), (PLACE, LEVEL), 0.0)
        self.said: list[str] = []
        self.asked = (PLACE, MOVES["lift its nose"])
        """Where the last move began, and where it led."""

    def follow(self, until: str = "") -> None:
        """Does what is asked, up to the line that begins so; else to the end."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.said.append(line.rstrip())
            move = next((move for words, move in MOVES.items() if words in line), None)
            if until and line.startswith(until):
                return
            if move is not None:
                self.asked = (PLACE if "level again" in line else self.hand.way[1][0], move)
            if move is not None or "Once more" in line:
                start, asked = self.asked
                self.hand.move(start, LEVEL)
                self.hand.move(start, LEVEL)  # it lies still
                self.hand.move(*asked)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self.hand.close()

    def found(self) -> dict[str, dict[str, str]]:
        assert self.process.wait(timeout=20) in {0, 1}
        return {c["name"]: c for c in json.loads(self.figures.read_text())["conditions"]}


@pytest.fixture
def checked(rig: Rig) -> Iterator[list[Checked]]:
    """Those that were begun; they end with the test."""
    begun: list[Checked] = []
    yield begun
    for one in begun:
        one.close()


def test_who_is_mounted_as_the_file_says_is_stamped_and_then_start_is_not_refused(
    rig: Rig, checked: list[Checked]
) -> None:
    one = Checked(rig)
    checked.append(one)
    one.follow()
    found = one.found()
    assert one.process.returncode == 0, one.said
    moves = ["level", "nose up", "roll right", "turn left", "lift", "forward", "left"]
    for name in [*moves, "colour", "depth", "accelerometer", "stamp"]:
        assert found[name]["level"] == "ok", found[name]
    assert "turned to the left" in found["turn left"]["text"]
    stamp = rig.folder / "alpha.mounting.toml"
    assert "tilt_deg = 5.0" in stamp.read_text()
    one.close()
    for there in (True, False):
        if not there:
            stamp.unlink()
        air = rig.air(vehicle=rig.folder / "alpha.toml")
        with rig.link() as link:
            snap = link.wait_for(lambda s: s.health is not None and bool(s.health.checks), 30.0)
            assert snap is not None and snap.health is not None
            mounting = next(check for check in snap.health.checks if check.name == "mounting")
            assert mounting.ok == there and ("check --frames" in mounting.reason) == (not there)
            reply = link.start()
            assert not reply.accepted  # no camera now
        air.terminate()
        air.wait(timeout=20)


def test_a_camera_that_hangs_upside_down_is_named_and_nothing_is_stamped(rig: Rig, checked: list[Checked]) -> None:
    one = Checked(rig, hung=Rotation.from_euler("X", 180, degrees=True))
    checked.append(one)
    one.follow()
    found = one.found()
    assert one.process.returncode == 1
    assert found["roll right"]["level"] == "ok"
    for picture in ["colour", "depth"]:
        assert found[picture]["level"] == "failed" and "upside down" in found[picture]["text"], found[picture]
    assert not (rig.folder / "alpha.mounting.toml").exists()


def test_an_autopilot_that_is_mounted_backwards_is_named_with_what_to_set(rig: Rig, checked: list[Checked]) -> None:
    one = Checked(rig, board=Rotation.from_euler("Z", math.pi))
    checked.append(one)
    one.follow(until="FAILED   nose up")
    assert "it says 20° nose down" in one.said[-1] and "SENS_BOARD_ROT" in one.said[-1], one.said


def test_a_stamp_that_cannot_be_written_is_told_before_the_first_move(rig: Rig) -> None:
    (rig.folder / "alpha.mounting.part").mkdir()  # stands where the stamp is made
    command = [str(BIN / "goshawk-air"), "check", "--frames", "--config", str(vehicle(rig)), "--listen", rig.endpoint]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "the stamp cannot be written beside" in done.stdout
    assert "Propellers off" not in done.stdout


def test_the_hand_checks_take_no_option_that_they_do_not_use(rig: Rig) -> None:
    command = [str(BIN / "goshawk-air"), "check", "--frames", "--config", str(vehicle(rig)), "--log-dir", "logs"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "cannot be used with" in done.stderr


def test_rates_of_the_wrong_sign_are_named_and_nothing_is_stamped(rig: Rig, checked: list[Checked]) -> None:
    one = Checked(rig)
    checked.append(one)
    one.hand.rates_sign = -1.0
    one.follow(until="FAILED   nose up")
    assert "20° nose up, and its rates" in one.said[-1] and "nose down" in one.said[-1], one.said
    assert not (rig.folder / "alpha.mounting.toml").exists()
