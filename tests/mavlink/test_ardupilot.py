"""The link flown as ArduPilot, against a copter made of pymavlink, over TCP and over a serial line."""

from __future__ import annotations

import json
import math
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from copter import EKF_HAS, EKF_PREDICTED, GUIDED, GUIDED_NOGPS, LAND, LOITER, Copter, Port, Serial, Tcp
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from wire import Wire

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(params=[Tcp, Serial])
def port(request: pytest.FixtureRequest) -> Iterator[Port]:
    port = request.param()
    yield port
    port.close()


@pytest.fixture
def copter(port: Port) -> Copter:
    return Copter(port=port)


@pytest.fixture
def link(example: Callable[[str], Path], port: Port) -> Iterator[Wire]:
    link = Wire(example("wire"), port.address, "ardupilot")
    yield link
    link.close()


def ready(copter: Copter, link: Wire) -> None:
    copter.until(lambda: link.read()["problem"] is None)


def test_it_is_ready_once_the_thrust_option_is_read_and_right(copter: Copter, link: Wire) -> None:
    copter.parameters["GUID_OPTIONS"] = 1.0
    copter.deaf_to = 3  # a lossy line: it is asked again
    assert link.read()["problem"] is not None
    copter.until(lambda: "GUID_OPTIONS is 1" in (link.read()["problem"] or ""))
    assert "set it to 9" in link.read()["problem"]
    copter.mode = GUIDED
    copter.until(lambda: link.read()["mode"] == "GUIDED")
    assert not link.read()["offboard"], "it would climb by what we mean as thrust"
    copter.parameters["GUID_OPTIONS"] = 9.0  # set at a ground station; nobody tells us
    ready(copter, link)
    assert copter.counts["PARAM_REQUEST_READ"] > 4
    asked = copter.counts["PARAM_REQUEST_READ"]
    end = time.monotonic() + 1.2
    copter.until(lambda: time.monotonic() > end)
    assert copter.counts["PARAM_REQUEST_READ"] <= asked + 1, "what is known is not asked for"


def test_an_option_that_is_cleared_in_flight_ends_authority(copter: Copter, link: Wire) -> None:
    ready(copter, link)
    copter.mode = GUIDED
    copter.until(lambda: link.read()["offboard"])
    copter.parameters["GUID_OPTIONS"] = 0.0
    copter.tell("GUID_OPTIONS")  # as ArduPilot does on every link when one of them sets it
    copter.until(lambda: not link.read()["offboard"])


def test_it_flies_guided_and_lands_and_the_pilot_may_take_it_away(copter: Copter, link: Wire) -> None:
    ready(copter, link)
    link.tell("request offboard")
    copter.until(lambda: copter.mode == GUIDED and link.read()["offboard"])
    link.tell("request arm")
    copter.until(lambda: copter.armed and link.read()["armed"] and link.read()["landed"] is False)
    copter.mode = LOITER  # the pilot's switch
    copter.until(lambda: link.read()["mode"] == "LOITER")
    assert not link.read()["offboard"]
    link.tell("request offboard")
    copter.until(lambda: link.read()["offboard"])
    link.tell("request hand-back")
    copter.until(lambda: copter.mode == LAND and link.read()["mode"] == "LAND")
    link.tell("request disarm")
    copter.until(lambda: not copter.armed and not link.read()["armed"])
    assert copter.denied == [], "nothing is asked of it that ArduPilot does not have"


def test_arming_that_it_refuses_is_told(copter: Copter, link: Wire) -> None:
    ready(copter, link)
    link.tell("request arm")  # not in a guided mode
    answers: list[list[str]] = []

    def refused() -> bool:
        answers.extend(link.read()["acks"])
        return ["arm", "failed"] in answers

    copter.until(refused)


def test_setpoints_arrive_with_attitude_and_thrust(copter: Copter, link: Wire) -> None:
    ready(copter, link)
    s = math.sqrt(0.5)
    assert link.tell(f"setpoint {s} 0 0 {s} 0.375") == {"error": None}  # facing north
    copter.until(lambda: len(copter.setpoints) > 0)
    setpoint = copter.setpoints[0]
    assert max(abs(a - b) for a, b in zip(setpoint.q, [1.0, 0.0, 0.0, 0.0], strict=True)) < 1e-6
    assert (setpoint.type_mask, setpoint.thrust) == (7, 0.375)
    norm = math.sqrt(sum(value * value for value in setpoint.q))
    assert abs(norm - 1.0) < 1e-4, "ArduPilot holds its position at a quaternion that is 0.001 off"


def test_motion_battery_and_clock_come_from_what_ardupilot_has(copter: Copter, link: Wire) -> None:
    copter.heading_rad, copter.north_m = math.pi / 2, 3.0
    copter.until(lambda: link.read()["odometry"] is not None and link.read()["round_trip_s"] is not None)
    odometry = link.read()["odometry"]
    assert odometry["pos_world"] == pytest.approx([0.0, 3.0, 2.0], abs=1e-5)
    assert abs(odometry["world_from_body"][0]) == pytest.approx(1.0)  # facing east is ENU's zero
    assert odometry["reset_counter"] == 0
    copter.until(lambda: link.read()["battery_fraction"] == 0.87)
    rates_us = {name: round(us) for name, us in copter.intervals_us.items()}
    assert rates_us[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION] == 10_000
    assert rates_us[mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED] == 10_000
    assert rates_us[mavlink.MAVLINK_MSG_ID_HEARTBEAT] == 100_000
    copter.north_m = 8.0  # its estimator is reset; nothing says so
    copter.until(lambda: link.read()["odometry"]["reset_counter"] == 1)


def test_its_estimators_word_on_the_position_counts(copter: Copter, link: Wire) -> None:
    copter.ekf_flags = EKF_PREDICTED  # it will have one as soon as it moves
    copter.until(lambda: link.read()["position"] is True)
    copter.armed = True  # it flies
    copter.until(lambda: link.read()["position"] is False)
    assert "its estimator says that the horizontal position is not valid" in link.read()["position_fault"]
    copter.ekf_flags = EKF_HAS
    copter.until(lambda: link.read()["position"] is True)
    copter.ekf_flags = EKF_HAS | mavlink.EKF_CONST_POS_MODE
    copter.until(lambda: link.read()["position"] is False)
    assert copter.intervals_us[mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT] == 100_000
    assert link.read()["position_fault"] is not None and copter.denied == []


def test_guided_without_gps_is_a_mode_of_its_own(example: Callable[[str], Path]) -> None:
    port = Tcp()
    copter, link = Copter(port=port), Wire(example("wire"), port.address, "ardupilot-nogps")
    ready(copter, link)
    link.tell("request offboard")
    copter.until(lambda: copter.mode == GUIDED_NOGPS and link.read()["offboard"])
    copter.mode = GUIDED
    copter.until(lambda: not link.read()["offboard"])
    link.close()
    port.close()


def test_flown_as_px4_it_is_no_autopilot_to_start_with(example: Callable[[str], Path]) -> None:
    port = Tcp()
    copter, link = Copter(port=port), Wire(example("wire"), port.address, "px4")
    copter.until(lambda: 'set firmware = "ardupilot"' in (link.read()["problem"] or ""))
    link.close()
    port.close()


def test_after_a_cut_connection_it_goes_on(example: Callable[[str], Path]) -> None:
    port = Tcp()
    copter, link = Copter(port=port), Wire(example("wire"), port.address, "ardupilot")
    ready(copter, link)
    port.cut()
    copter.mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    copter.intervals_us = {mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1e6}  # another connection streams nothing yet
    copter.until(lambda: mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION in copter.intervals_us)
    assert copter.setpoints == []
    # One that meets another thread at the line is not sent: the next is.
    copter.until(lambda: link.tell("setpoint 1 0 0 0 0.5") == {"error": None})
    copter.until(lambda: len(copter.setpoints) == 1)
    ready(copter, link)
    link.close()
    port.close()


@pytest.mark.parametrize(("options", "timeout_s", "well"), [(8.0, 0.5, True), (0.0, 3.0, False)])
def test_check_reads_what_ardupilot_is_set_to(
    air: Path, tmp_path: Path, options: float, timeout_s: float, well: bool
) -> None:
    port = Tcp()
    copter = Copter(port=port, parameters={"GUID_OPTIONS": options, "GUID_TIMEOUT": timeout_s})
    config, figures = tmp_path / "vehicle.toml", tmp_path / "check.json"
    text = (ROOT / "air/vehicles/sim.toml").read_text()
    for old, new in [
        ('link = "udpin:127.0.0.1:14540"', f'link = "{port.address}"'),
        ('firmware = "px4"', 'firmware = "ardupilot"'),
        ('"../models', f'"{ROOT / "air/models"}'),
        ('"tuning.toml"', f'"{ROOT / "air/vehicles/tuning.toml"}"'),
        ("tcp/127.0.0.1:7447", "tcp/127.0.0.1:0"),
    ]:
        assert old in text
        text = text.replace(old, new)
    config.write_text(text)
    command = [air, "check", "--config", config, "--wait", "6", "--json", figures, "--log-dir", tmp_path]
    checking = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL)
    while checking.poll() is None:
        try:
            copter.pump()
        except OSError:  # it has seen enough, and hung up
            break
    assert checking.wait(timeout=20) == 1  # there is no camera
    found = {condition["name"]: condition for condition in json.loads(figures.read_text())["conditions"]}
    levels = {name: found[name]["level"] for name in ["autopilot", "GUID_OPTIONS", "GUID_TIMEOUT"]}
    assert levels == dict.fromkeys(levels, "ok" if well else "failed"), found
    assert found["clocks"]["level"] == found["battery"]["level"] == found["odometry"]["level"] == "ok", found
    assert found["position"]["level"] == "ok", found
    if well:
        assert "ArduPilot, mode STABILIZE" in found["autopilot"]["text"]
    else:
        assert "set it to 8" in found["GUID_OPTIONS"]["text"]
        assert "3: without us it waits that long; set 0.5" in found["GUID_TIMEOUT"]["text"]
    port.close()
