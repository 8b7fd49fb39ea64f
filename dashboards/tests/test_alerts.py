"""What an operator is told when something is wrong."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from goshawk_dashboards.state.alerts import HOLD_S, AlertBoard, alerts
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import AutopilotView, CommandView, StopView
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb

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
    landed = replace(base, control=None, health=replace(base.health, mode=pb.MODE_READY))
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
    (alert,) = alerts(replace(base, control=replace(base.control, fallback=pb.FALLBACK_PLAN_EXPIRED_BRAKE)))
    assert alert.severe
    assert "plan expired brake" in alert.text


def test_faults_and_battery_count_in_flight_only(snap: Make) -> None:
    base = snap()
    assert base.health is not None
    assert base.control is not None
    sick = replace(base, health=replace(base.health, faults=("odometry: stale",), battery_fraction=0.08))
    assert keys(sick) == ["fault 0", "battery"]
    idle = replace(sick, control=replace(base.control, mode=pb.MODE_IDLE))
    assert keys(idle) == []


def test_a_stop_that_was_given_up_is_severe_for_a_while(snap: Make) -> None:
    text = "Stop not delivered. Pilot: take over. There is no link."
    command = CommandView(verb="stop", command_id="1", answered=False, accepted=False, text=text, mode=None, at_s=99.0)
    (alert,) = alerts(snap(command=command))
    assert (alert.severe, alert.text) == (True, text)
    assert keys(snap(command=replace(command, cancelled=True))) == []
    assert keys(snap(command=replace(command, pending=True))) == []
    assert keys(snap(command=replace(command, at_s=50.0))) == []


def test_a_refused_stop_tells_the_pilot_what_to_do(snap: Make) -> None:
    command = CommandView(
        verb="stop", command_id="1", answered=True, accepted=False, text="the controller did not answer", mode=None
    )
    (alert,) = alerts(snap(command=command))
    assert alert.severe
    assert alert.text == "Stop refused: the controller did not answer. Pilot: take over."


def test_a_stop_that_is_not_confirmed_is_told_with_its_age_until_it_is(snap: Make) -> None:
    stop = StopView(command_id="1", age_s=7.4)
    (alert,) = alerts(snap(stop=stop))
    assert (alert.severe, alert.text) == (True, "STOP PENDING for 7 s: not delivered. Pilot: take over.")
    assert alerts(snap(stop=replace(stop, age_s=0.4))) == []
    assert "for 5 min" in alerts(snap(stop=replace(stop, age_s=300.0)))[0].text
    (lapsed,) = alerts(snap(stop=replace(stop, age_s=900.0, lapsed=True)))
    assert not lapsed.severe
    assert "15 min ago was never delivered" in lapsed.text


def test_a_vehicle_of_another_protocol_is_told_in_one_line(snap: Make) -> None:
    base = snap()
    assert base.health is not None
    (older,) = alerts(replace(base, health=replace(base.health, protocol=0)))
    assert older.text == (
        f"only Stop works: goshawk speaks protocol 0, this ground station {PROTOCOL}. Update the vehicle."
    )
    (newer,) = alerts(replace(base, health=replace(base.health, protocol=PROTOCOL + 1)))
    assert newer.text.endswith("Update the ground station.")


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
    sick = replace(base, control=replace(base.control, fallback=pb.FALLBACK_HOLD_POSITION))
    assert [a.over for a in board.update(sick)] == [False]
    assert [a.over for a in board.update(replace(base, now_s=base.now_s + 0.3))] == [True]
    assert board.update(replace(base, now_s=base.now_s + HOLD_S + 0.5)) == []
