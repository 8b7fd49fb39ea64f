"""An autopilot that is not what it seems: each mishap of the stand-in, and what the vehicle makes of it.

`pytest tests/e2e/test_autopilot.py -s` prints the figures as a table.
"""

from __future__ import annotations

import json
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.link import GroundLink
from goshawk_proto import goshawk_pb2 as pb
from rig import BIN, VEHICLE, Rig, copied

FLYING = {pb.MODE_TRACK, pb.MODE_SEARCH, pb.MODE_HOLD}


@pytest.fixture(scope="module")
def figures() -> Iterator[list[tuple[str, str]]]:
    """Rows of what happened and what came of it; printed as a table at the end."""
    rows: list[tuple[str, str]] = []
    yield rows
    print("\n" + "\n".join(f"| {what:<34} | {came:<60} |" for what, came in rows))


def told(snap: Snapshot, words: str) -> int | None:
    """When an event with these words came, ns; None: none did."""
    return next((e.stamp_ns for e in snap.events if words in e.text), None)


def failing(snap: Snapshot) -> dict[str, str]:
    return {} if snap.health is None else {c.name: c.reason for c in snap.health.checks if not c.ok}


def only_failing(link: GroundLink, name: str) -> str:
    """Waits until this check alone fails; its reason."""
    snap = link.wait_for(lambda s: set(failing(s)) == {name}, 40.0)
    assert snap is not None, failing(link.snapshot())
    assert link.wait_for(lambda s: set(failing(s)) != {name}, 2.0) is None, "it stays so"
    assert not link.start().accepted
    return failing(snap)[name]


def take_off(rig: Rig, link: GroundLink) -> None:
    ready = link.wait_for(lambda s: s.health is not None and s.health.ready, 40.0)
    assert ready is not None, rig.output("air") + rig.output("sim")
    reply = link.start()
    assert reply.accepted, reply.text


def ask_to_arm(rig: Rig, link: GroundLink) -> None:
    """A take-off up to where the autopilot has been asked to arm. One that arms late will, 2 s after."""
    take_off(rig, link)
    asked = link.wait_for(lambda s: s.health is not None and s.health.autopilot == "OFFBOARD", 20.0)
    assert asked is not None, rig.output("air")
    time.sleep(0.7)


def airborne(snap: Snapshot) -> bool:
    return snap.mode in FLYING and snap.truth is not None and snap.truth.pos_world_3[2] > 0.8


@pytest.mark.parametrize(
    ("mishap", "check", "words"),
    [
        ("no-position", "odometry", "no valid position"),
        ("unarmable", "autopilot", "COM_ARMABLE"),
        ("deaf", "autopilot", "does not answer"),
    ],
)
def test_what_the_autopilot_lacks_on_the_ground_makes_it_not_ready_in_words(
    rig: Rig, figures: list[tuple[str, str]], mishap: str, check: str, words: str
) -> None:
    rig.air()
    rig.sim("--mishap", mishap)
    with rig.link() as link:
        reason = only_failing(link, check)
    assert words in reason
    figures.append((f"{mishap}, on the ground", f"not ready: {check}: {reason[:40]}"))


def test_a_position_lost_in_flight_is_told_and_comes_down_the_ladder(rig: Rig, figures: list[tuple[str, str]]) -> None:
    rig.air()
    rig.sim("--seed", "5", "--spacing", "6", "--speed", "2", "--mishap", "no-position@6")
    with rig.link() as link:
        take_off(rig, link)
        blind = link.wait_for(
            lambda s: s.control is not None and s.control.fallback == pb.FALLBACK_ODOMETRY_STALE_DESCEND, 40.0
        )
        assert blind is not None, rig.output("air")
        assert "NoPosition" in rig.output("sim")
        fault = link.wait_for(lambda s: s.mode == pb.MODE_FAULT, 10.0)
        assert fault is not None, rig.output("air")
        events = link.wait_for(lambda s: told(s, "the autopilot has lost its position") is not None, 5.0)
        assert events is not None, [e.text for e in link.snapshot().events]
        # What it says meanwhile is no motion that its accelerometer feels: that may be noticed first.
        noticed = told(events, "no valid position") or told(events, "autopilot's position is false")
        handed_back = told(events, "has lost its position")
        assert noticed is not None and handed_back is not None
        figures.append(
            ("no-position, in flight", f"handed back {(handed_back - noticed) * 1e-9:.1f} s after its event")
        )
        assert link.wait_for(lambda s: s.health is not None and s.health.autopilot == "AUTO.LAND", 5.0) is not None


def test_a_take_off_given_up_while_the_autopilot_arms_is_disarmed(rig: Rig, figures: list[tuple[str, str]]) -> None:
    rig.air()
    rig.sim("--mishap", "late-arming")
    with rig.link() as link:
        ask_to_arm(rig, link)
        assert link.stop().accepted
        disarmed = link.wait_for(lambda s: told(s, "the motors are disarmed") is not None, 15.0)
        assert disarmed is not None, [e.text for e in link.snapshot().events]
        begun, ended = told(disarmed, "the motors are armed"), told(disarmed, "the motors are disarmed")
        assert begun is not None and ended is not None
        took = (ended - begun) * 1e-9
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 10.0) is not None
    assert took < 2.5, "without being asked it disarms after 10 s"
    figures.append(("late-arming, given up", f"armed on the ground for {took:.1f} s"))


@pytest.mark.parametrize(("stopped", "says"), [(False, "ended in the take-off"), (True, "ended just after a take-off")])
def test_a_process_that_is_ended_in_the_take_off_leaves_no_motor_running(
    rig: Rig, figures: list[tuple[str, str]], stopped: bool, says: str
) -> None:
    air = rig.air()
    rig.sim("--mishap", "late-arming")
    with rig.link() as link:
        ask_to_arm(rig, link)
        if stopped:
            assert link.stop().accepted
            assert link.wait_for(lambda s: s.mode in {pb.MODE_IDLE, pb.MODE_READY}, 5.0) is not None
        begun_s = time.monotonic()
        air.terminate()
        assert air.wait(20.0) == 0, rig.output("air")
        took_s = time.monotonic() - begun_s
    said = [line for line in rig.output("air").splitlines() if says in line or "the motors are" in line]
    assert says in said[0] and "the motors are armed" in "".join(said), said
    assert "the motors are disarmed" in said[-1], said
    figures.append(
        (f"late-arming, process ended{' after a stop' * stopped}", f"it ended {took_s:.1f} s later, disarmed")
    )


def test_motors_that_are_cut_are_disarmed_though_the_autopilot_never_notices_the_ground(
    rig: Rig, figures: list[tuple[str, str]]
) -> None:
    rig.air()
    rig.sim("--seed", "5", "--spacing", "6", "--speed", "2", "--mishap", "numb")
    with rig.link() as link:
        take_off(rig, link)
        assert link.wait_for(airborne, 20.0) is not None, rig.output("air")
        assert link.stop().accepted
        disarmed = link.wait_for(lambda s: told(s, "disarm, forced") is not None, 40.0)
        assert disarmed is not None, rig.output("air")
        again = link.wait_for(lambda s: s.mode == pb.MODE_READY, 15.0)
        assert again is not None, rig.output("air")
    figures.append(("numb, landed", "disarmed by force once the motors had been cut for a while"))


def test_a_stop_that_finds_no_flight_says_so(rig: Rig) -> None:
    rig.air()
    rig.sim()
    with rig.link() as link:
        assert link.wait_for(lambda s: s.mode == pb.MODE_READY, 30.0) is not None, rig.output("air")
        stopped = link.stop()
        assert stopped.accepted and "nothing is sent" in stopped.text, stopped


def test_a_restart_in_flight_is_told_and_nothing_is_asked_of_the_new_one(
    rig: Rig, figures: list[tuple[str, str]]
) -> None:
    rig.air()
    rig.sim("--seed", "5", "--spacing", "6", "--speed", "2", "--mishap", "restart@3")
    with rig.link() as link:
        take_off(rig, link)
        again = link.wait_for(lambda s: told(s, "it has started again") is not None, 40.0)
        assert again is not None, rig.output("air")
        restarted = told(again, "it has started again")
        assert restarted is not None
        time.sleep(5.0)
        snap = link.snapshot()
        assert snap.health is not None and snap.health.autopilot == "AUTO.LOITER", snap.health
        orders = re.compile(r"^(set mode|arm|disarm)")
        since = [e.text for e in snap.events if e.stamp_ns > restarted and orders.match(e.text)]
        assert all("not answered" in text for text in since), since
        assert snap.mode in {pb.MODE_FAULT, pb.MODE_IDLE, pb.MODE_READY}
    figures.append(("restart, in flight", "told; it stays in AUTO.LOITER, disarmed, no order was sent"))


def test_messages_that_nobody_knows_are_no_loss(rig: Rig, figures: list[tuple[str, str]]) -> None:
    rig.air()
    rig.sim("--mishap", "unknown-messages")
    with rig.link() as link:
        assert link.wait_for(lambda s: s.health is not None and s.health.ready, 40.0) is not None
        time.sleep(10.0)
        health = link.snapshot().health
        assert health is not None
        lost = dict(health.drops)["mavlink_lost"]
    assert lost == 0
    figures.append(("unknown-messages, 10 s", f"{lost} counted as lost"))


def test_a_slow_push_of_a_stick_flies_on_and_a_quick_one_ends_authority(
    rig: Rig, figures: list[tuple[str, str]]
) -> None:
    rig.air()
    rig.sim("--seed", "5", "--spacing", "6", "--speed", "2", "--mishap", "sticks=0.5@3", "--mishap", "sticks=1.5@6")
    with rig.link() as link:
        take_off(rig, link)
        assert link.wait_for(lambda _: "Sticks(0.5)" in rig.output("sim"), 40.0) is not None
        time.sleep(1.5)
        assert airborne(link.snapshot()), "a slow push takes nothing over: MAN_OVERRIDE_SPD is 1"
        fault = link.wait_for(lambda s: s.mode == pb.MODE_FAULT, 10.0)
        assert fault is not None, rig.output("air")
        assert link.wait_for(lambda s: told(s, "taken away by the pilot") is not None, 5.0) is not None
    figures.append(("sticks at 0.5, then 1.5 travels/s", "flies on; ends authority"))


def test_an_attitude_that_lags_by_300_ms_is_flown(rig: Rig, figures: list[tuple[str, str]]) -> None:
    rig.air()
    rig.sim("--seed", "5", "--spacing", "8", "--speed", "2", "--attitude-lag", "0.3")
    with rig.link() as link:
        take_off(rig, link)
        assert link.wait_for(airborne, 30.0) is not None, rig.output("air")
        time.sleep(8.0)
        snap = link.snapshot()
        assert airborne(snap), (snap.mode, [e.text for e in snap.events])
        assert link.stop().accepted
        assert link.wait_for(lambda s: s.mode in {pb.MODE_LANDED, pb.MODE_READY, pb.MODE_IDLE}, 40.0) is not None
    figures.append(("attitude lag 0.3 s", "takes off, flies for 8 s, lands"))


def check(rig: Rig, config: Path) -> dict[str, dict[str, str]]:
    found = rig.folder / "check.json"
    command = [BIN / "goshawk-air", "check", "--config", config, "--listen", rig.endpoint, "--mavlink-bind",
               f"127.0.0.1:{rig.mavlink_port}", "--wait", "12", "--json", found, "--log-dir", rig.logs]  # fmt: skip
    subprocess.run([str(c) for c in command], capture_output=True, timeout=60, check=False)
    return {c["name"]: c for c in json.loads(found.read_text())["conditions"]}


@pytest.mark.parametrize(
    ("arguments", "condition", "level", "words"),
    [
        ((), "MAN_OVERRIDE_SPD", "ok", "a slow push does not"),
        (("--man-override-spd", "-1"), "MAN_OVERRIDE_SPD", "warning", "mode switch alone"),
        (("--mishap", "no-position"), "position", "failed", "no valid position"),
        (("--mishap", "unarmable"), "autopilot", "failed", "COM_ARMABLE"),
        (("--mishap", "deaf"), "autopilot", "failed", "does not answer"),
    ],
)
def test_check_says_it_before_a_flight(
    rig: Rig, figures: list[tuple[str, str]], arguments: tuple[str, ...], condition: str, level: str, words: str
) -> None:
    rig.sim(*arguments)
    found = check(rig, VEHICLE)[condition]
    assert found["level"] == level, found
    assert words in found["text"]
    figures.append((f"check, {' '.join(arguments) or 'as it is'}", f"{level}: {found['text'][:50]}"))


def test_a_wrong_target_system_is_told_with_the_right_one(
    rig: Rig, figures: list[tuple[str, str]], tmp_path: Path
) -> None:
    text = copied()
    config = tmp_path / "vehicle.toml"
    config.write_text(re.sub(r"(?m)^target_system = \d+", "target_system = 7", text))
    assert "target_system = 7" in config.read_text()
    rig.sim()
    found = check(rig, config)["autopilot"]
    assert found["level"] == "failed"
    assert "target_system = 1" in found["text"]
    figures.append(("check, target_system = 7", found["text"][:60]))
