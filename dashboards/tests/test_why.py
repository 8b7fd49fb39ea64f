"""Why a flight ended, told first: the cause that ended it, not what the vehicle did on the ground afterwards."""

from __future__ import annotations

from pathlib import Path

import pytest
import recordings as rec
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.why import why
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb

START = ("Idle → Ready: all readiness checks hold", "Ready → Takeoff: the operator's Start")
CLIMBED = (*START, "Takeoff → Search: the take-off height is reached", "Search → Track: the target is confirmed")
LANDED = ("Stopping → Landed: landed and disarmed", "Landed → Ready: all readiness checks hold")


def told(path: Path, *changes: str) -> list[str]:
    """What is said of a flight with these changes of mode, one a second."""
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite"))
    log.write("control", rec.START_NS, pb.Control(mode=pb.MODE_IDLE))
    for k, text in enumerate(changes, 1):
        stamp_ns = rec.START_NS + k * 1_000_000_000
        log.write("event", stamp_ns, pb.Event(stamp_ns=stamp_ns, severity=pb.SEVERITY_INFO, kind="mode", text=text))
    log.close()
    return why(Flight.open(path))


@pytest.mark.parametrize(
    "end",
    [
        "Track → Stopping: the operator's Stop",
        "Navigate → Stopping: the fence is reached",
        "Search → Stopping: the battery is low",
        "Hold → Stopping: the operator's Stop",
    ],
)
def test_a_flight_that_landed_tells_what_ended_it(end: str, tmp_path: Path) -> None:
    assert told(tmp_path / "x.mcap", *CLIMBED, end, *LANDED) == [f"What ended the flight came at 5.00 s. {end}."]


def test_a_take_off_that_was_given_up_tells_why(tmp_path: Path) -> None:
    refused = "Takeoff → Fault: the autopilot did not arm"
    sentences = told(tmp_path / "x.mcap", *START, refused, "Fault → Idle: the fault is over")
    assert sentences == [f"What ended the flight came at 3.00 s. {refused}."]
    stopped = "Takeoff → Idle: the operator's Stop"
    assert told(tmp_path / "y.mcap", *START, stopped) == [f"What ended the flight came at 3.00 s. {stopped}."]


def test_a_landing_that_was_taken_away_is_told_after_what_began_it(tmp_path: Path) -> None:
    end, taken = "Track → Stopping: the fence is reached", "Stopping → Fault: odometry stayed stale"
    assert told(tmp_path / "x.mcap", *CLIMBED, end, taken, "Fault → Idle: the fault is over") == [
        f"What ended the flight came at 5.00 s. {end}.", f"Its last change of mode came at 6.00 s. {taken}."
    ]  # fmt: skip


def test_of_a_flight_that_goes_on_at_the_end_the_last_change_is_told(tmp_path: Path) -> None:
    first = (*CLIMBED, "Track → Stopping: the operator's Stop", *LANDED)
    again = "Ready → Takeoff: the operator's Start"
    assert told(tmp_path / "x.mcap", *first, again) == [f"Its last change of mode came at 8.00 s. {again}."]
    lost = "Track → Search: the target has not been seen for too long"
    assert told(tmp_path / "y.mcap", *CLIMBED, lost) == [f"Its last change of mode came at 5.00 s. {lost}."]


def test_a_vehicle_that_never_took_off_tells_its_last_change(tmp_path: Path) -> None:
    assert told(tmp_path / "x.mcap", START[0]) == [f"Its last change of mode came at 1.00 s. {START[0]}."]
