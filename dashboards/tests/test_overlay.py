"""What lies over the whole window, and what the candidates' and vehicles' tables say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
from goshawk_dashboards.live import candidates, fleet, link, overlay, phone
from goshawk_dashboards.state.alerts import Alert
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import AutopilotView, CommandView, PreviewView
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]

STOP = overlay.Stops(one="Stop")
PICTURE = PreviewView(seq=1, stamp_ns=1, width=160, height=96, picture=b"\xff\xd8\xff\xe0")


def over(snap: Snapshot, shown: list[tuple[str, Alert]]) -> str:
    """The layer of a viewer who may stop the vehicle."""
    return overlay.overlay_html(snap, shown, stops=STOP)


def test_only_a_severe_alert_reddens_the_edge(snap: Make) -> None:
    mild = Alert(key="a", severe=False, text="look soon")
    severe = Alert(key="b", severe=True, text="look now")
    assert 'data-goshawk="edge"' not in over(snap(), [("", mild)])
    assert 'data-goshawk="edge"' in over(snap(), [("", severe)])
    assert 'data-goshawk="edge"' not in over(snap(), [("", replace(severe, over=True))])


def test_a_command_is_shown_from_the_press_to_the_reply(snap: Make) -> None:
    sent = CommandView(
        verb="stop", command_id="1", answered=False, accepted=False, text="x", mode=None, pending=True, at_s=98.8
    )
    assert "waiting for the vehicle to reply, 1.2 s" in over(snap(command=sent), [])
    done = replace(sent, pending=False, answered=True, accepted=True, text="braking", took_s=0.012)
    assert "vehicle confirms stop after 12 ms: braking" in over(snap(command=done), [])
    lost = replace(sent, pending=False, text="no link")
    assert "stop NOT CONFIRMED: no link" in over(snap(command=lost), [])
    assert "toast" not in over(snap(command=replace(done, at_s=10.0)), [])


def test_what_a_silent_vehicle_showed_loses_its_colour(snap: Make) -> None:
    assert "grayscale" in over(snap(age_s=5.0), [])
    assert "grayscale" not in over(snap(), [])


def test_no_script_of_a_page_comes_as_the_error_of_a_picture() -> None:
    package = resources.files("goshawk_dashboards")
    assert isinstance(package, Path)
    texts = [path for path in package.rglob("*") if path.suffix in (".py", ".js", ".css")]
    assert package / "live/overlay.py" in texts
    assert [path for path in texts if "onerror=" in path.read_text(encoding="utf-8")] == []
    assert "<script>" in overlay.foot_html()


def test_a_phone_shows_the_state_and_on_the_ground_what_is_not_ready_in_flight_the_picture(snap: Make) -> None:
    base = snap(preview=PICTURE)
    assert base.health is not None and base.control is not None
    check = replace(base.health.checks[0], ok=False, reason="no odometry yet")
    standing = replace(
        base, control=replace(base.control, mode=pb.MODE_IDLE), health=replace(base.health, checks=(check,))
    )
    shown = [phone.phone_html(s, "STATE", candidates.picture_html(s, fresh=True)) for s in (base, standing)]
    assert all("STATE" in page for page in shown)
    assert [("<img" in page, "no odometry yet" in page) for page in shown] == [(True, False), (False, True)]
    assert shown[0] in overlay.phone_over_html(shown[0])
    assert overlay.phone_over_html("") == ""


def test_the_strip_ranks_the_flown_first_then_by_cost(snap: Make) -> None:
    words = candidates.strip_html(snap(), fresh=True)
    order = [int(part.split('"')[0]) for part in words.split('data-candidate="')[1:]]
    assert order == [7, *[k for k in range(15) if k != 7]]
    assert 'data-candidate="0" data-rejection="objectness"' in words
    assert "candidate 9: cost 2.14, objectness 1.00, dearer than the one flown" in words
    assert "12 no target to chase, and it holds none; 2 dearer than the one flown" in words


def test_a_strip_without_a_choice_says_so(snap: Make) -> None:
    base = snap()
    assert base.plan is not None
    assert "nothing was eligible" in candidates.strip_html(
        replace(base, plan=replace(base.plan, chosen=None)), fresh=True
    )


def test_curves_and_the_estimate_are_drawn_where_the_camera_sees_them(snap: Make) -> None:
    base = snap(preview=PICTURE)
    assert base.plan is not None
    assert base.target is not None
    # Straight ahead of the camera, 10 m: the middle of the picture.
    ahead_3 = base.plan.start_pos_world_3 + np.array([10.0, 0.0, 0.0])
    words = candidates.picture_html(replace(base, target=replace(base.target, pos_world_3=ahead_3)), fresh=True)
    assert 'data-goshawk="estimate" x="74.0" y="38.0"' in words
    assert words.count("<g class") == 15
    behind_3 = base.plan.start_pos_world_3 - np.array([10.0, 0.0, 0.0])
    assert "estimate" not in candidates.picture_html(
        replace(base, target=replace(base.target, pos_world_3=behind_3)), fresh=True
    )


def test_left_in_the_world_is_left_in_the_picture(snap: Make) -> None:
    base = snap(preview=PICTURE)
    assert base.plan is not None
    assert base.target is not None
    left_3 = base.plan.start_pos_world_3 + np.array([10.0, 5.0, 0.0])
    words = candidates.picture_html(replace(base, target=replace(base.target, pos_world_3=left_3)), fresh=True)
    assert 'data-goshawk="estimate" x="34.0" y="38.0"' in words


def test_a_stale_plan_is_not_drawn_over_the_picture(snap: Make) -> None:
    assert "<g class" not in candidates.picture_html(snap(preview=PICTURE), fresh=False)


def test_the_fleet_marks_the_one_shown_and_the_silent(snap: Make) -> None:
    one, two = snap(vehicle="alpha"), snap(age_s=9.0, vehicle="bravo")
    words = fleet.fleet_html([one, two], "alpha")
    assert 'data-vehicle="alpha" data-mode="track" data-stale="false" data-shown="true"' in words
    assert 'data-vehicle="bravo" data-mode="track" data-stale="true" data-shown="false"' in words
    assert "VEHICLE SILENT" in words


def test_the_radio_shows_mode_battery_and_link(snap: Make) -> None:
    radio = AutopilotView(
        source="udpin:0.0.0.0:14550",
        age_s=0.4,
        mode="OFFBOARD",
        armed=True,
        battery_fraction=0.61,
        battery_v=15.12,
        loss_fraction=0.02,
        radio_rssi=(190, 180),
        rate_hz=30.0,
        texts=((pb.SEVERITY_ERROR, "Battery <low>"),),
    )
    words = link.radio_html(snap(autopilot=radio))
    for fact in ("OFFBOARD, ARMED", "61 %, 15.12 V", "2.0 %", "190, 180", "30 Hz", "Battery &lt;low&gt;", "read only"):
        assert fact in words
    assert "SILENT" in link.radio_html(snap(autopilot=replace(radio, age_s=8.0)))
    assert link.radio_html(snap()) == ""


def test_text_from_outside_is_never_markup(snap: Make) -> None:
    evil = "<script>alert(1)</script>"
    base = snap(vehicle=evil, preview=PICTURE)
    assert base.plan is not None
    hostile = replace(
        base,
        command=CommandView(
            verb=evil, command_id="1", answered=True, accepted=False, text=evil, mode=None, at_s=base.now_s
        ),
        autopilot=AutopilotView(source=evil, age_s=0.1, mode=evil, texts=((pb.SEVERITY_ERROR, evil),), trouble=evil),
    )
    for words in (
        over(hostile, [(evil, Alert(key=evil, severe=True, text=evil))]),
        fleet.fleet_html([hostile], evil),
        link.radio_html(hostile),
    ):
        assert "<script" not in words and "&lt;script&gt;" in words
    assert "<script" not in candidates.strip_html(hostile, fresh=True) + candidates.picture_html(hostile, fresh=True)
