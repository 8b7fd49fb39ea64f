"""What an operator is told when something is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from goshawk_dashboards.alerts import HOLD_S, AlertBoard, alerts
from goshawk_dashboards.snapshot import AutopilotView, CommandView, Snapshot

Make = Callable[..., Snapshot]


def keys(snap: Snapshot) -> list[str]:
    return [alert.key for alert in alerts(snap)]


def test_a_good_flight_has_no_alerts(snap: Make) -> None:
    assert alerts(snap()) == []


def test_a_vehicle_never_heard_is_no_alert(snap: Make) -> None:
    assert alerts(Snapshot(now_s=1.0, vehicle="goshawk", endpoint="tcp/x:1", linked=False, alive=False)) == []


def test_silence_in_flight_is_severe_and_on_the_ground_is_not(snap: Make) -> None:
    flying = alerts(snap(age_s=4.0))
    assert [(a.key, a.severe) for a in flying] == [("silent", True)]
    base = snap(age_s=4.0)
    assert base.control is not None
    assert base.health is not None
    landed = replace(base, control=None, health=replace(base.health, mode="ready"))
    assert [(a.key, a.severe) for a in alerts(landed)] == [("silent", False)]


def test_a_late_view_is_told(snap: Make) -> None:
    (slow,) = alerts(replace(snap(), round_trip_s=1.04))
    assert "1.0 s" in slow.text
    (mute,) = alerts(replace(snap(), round_trip_s=math.inf))
    assert "no answer" in mute.text
    assert alerts(replace(snap(), round_trip_s=0.3)) == []


def test_a_fallback_is_severe(snap: Make) -> None:
    base = snap()
    assert base.control is not None
    (alert,) = alerts(replace(base, control=replace(base.control, fallback="plan_expired_brake")))
    assert alert.severe
    assert "plan expired brake" in alert.text


def test_faults_and_battery_count_in_flight_only(snap: Make) -> None:
    base = snap()
    assert base.health is not None
    assert base.control is not None
    sick = replace(base, health=replace(base.health, faults=("odometry: stale",), battery_fraction=0.08))
    assert keys(sick) == ["fault 0", "battery"]
    idle = replace(sick, control=replace(base.control, mode="idle"))
    assert keys(idle) == []


def test_a_stop_without_reply_is_severe_for_a_while(snap: Make) -> None:
    command = CommandView(
        verb="stop", command_id="1", answered=False, accepted=False, text="no reply", mode=None, at_s=99.0
    )
    (alert,) = alerts(snap(command=command))
    assert alert.severe
    assert "NOT CONFIRMED" in alert.text
    assert keys(snap(command=replace(command, pending=True))) == []
    assert keys(snap(command=replace(command, at_s=50.0))) == []


def test_the_severe_come_first(snap: Make) -> None:
    base = snap()
    assert base.health is not None
    lossy = tuple(replace(c, loss_fraction=0.4) for c in base.channels)
    sick = replace(base, channels=lossy, health=replace(base.health, faults=("camera: frozen",)))
    assert keys(sick) == ["fault 0", "loss"]


def test_a_failsafe_heard_by_radio_is_severe(snap: Make) -> None:
    radio = AutopilotView(source="udpin:0.0.0.0:14550", age_s=0.5, failsafe=True)
    assert keys(snap(autopilot=radio)) == ["failsafe"]
    assert keys(snap(autopilot=replace(radio, failsafe=False))) == []
    assert keys(snap(autopilot=replace(radio, age_s=9.0))) == ["radio"]


def test_a_blink_of_trouble_stays_long_enough_to_be_read(snap: Make) -> None:
    board = AlertBoard()
    base = snap()
    assert base.control is not None
    sick = replace(base, control=replace(base.control, fallback="hold_position"))
    assert [a.over for a in board.update(sick)] == [False]
    assert [a.over for a in board.update(replace(base, now_s=base.now_s + 0.3))] == [True]
    assert board.update(replace(base, now_s=base.now_s + HOLD_S + 0.5)) == []
