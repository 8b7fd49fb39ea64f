"""Whether a vehicle is in the air: what stands feels no wind, wherever it landed, and a fault is no landing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.charts.derived import AXES, DERIVED
from goshawk_dashboards.gate import Access, Gate, Role
from goshawk_dashboards.instruments.panel import panel_html
from goshawk_dashboards.instruments.track import ACCELERATIONS, Track
from goshawk_dashboards.live import phone
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.page.serving import close_server, open_server
from goshawk_dashboards.report.report import make_report, write_page
from goshawk_dashboards.scene.scene import LiveScene, ViewOptions
from goshawk_dashboards.state import decode
from goshawk_dashboards.state.airborne import Ground, Step
from goshawk_dashboards.state.alerts import alerts
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import ControlView
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb

Make = Callable[..., Snapshot]

STEP_S = 0.05
FLOWN_S = (1.0, 4.0)
"""When the made-up vehicle is in the air."""
PRESSED_MPS2, PUSH_MPS2 = -9.81, 6.0
"""What its thrust alone would give on the ground, and what the observer then believes."""
SIGNALS = ("measured acceleration", "desired acceleration", "commanded acceleration", "disturbance",
           "true acceleration")  # fmt: skip


def flown(path: Path, modes: Callable[[float], pb.Mode], landed_z_m: float = 0.0) -> Flight:
    """Stands at 0 m, flies at 2 m from second 1 to 4, and stands where it landed. On the ground all accelerations are
    large, in the air small; the simulator's truth comes between the controller's steps."""
    log = rec.LogFile(path)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite"))
    for k in range(round(6.0 / STEP_S)):
        time_s, stamp_ns = k * STEP_S, rec.START_NS + round(k * STEP_S * 1e9)
        flies = FLOWN_S[0] <= time_s < FLOWN_S[1]
        z_m = 2.0 if flies else 0.0 if time_s < FLOWN_S[0] else landed_z_m
        small, large = pb.Vec3(x=0.5, y=0.5, z=0.5), pb.Vec3(x=PUSH_MPS2, y=PUSH_MPS2, z=PUSH_MPS2)
        felt = small if flies else large
        step = pb.Control(
            seq=k, stamp_ns=stamp_ns, mode=modes(time_s), pos_world=pb.Vec3(z=z_m), vel_world=pb.Vec3(),
            world_from_body=pb.Quat(w=1.0), thrust_n=8.0, acc_des_world=felt, acc_meas_world=felt,
            acc_disturbance_world=felt, acc_att_world=small if flies else pb.Vec3(x=9.0, y=9.0, z=PRESSED_MPS2),
        )  # fmt: skip
        log.write("control", stamp_ns, step)
        log.write("sim_truth", stamp_ns + 1_000_000, pb.SimTruth(stamp_ns=stamp_ns, acc_world=felt))
    log.close()
    return Flight.open(path)


def usual(time_s: float) -> pb.Mode:
    """Takes off, tracks, and lands from second 3 on; it is told to have landed after the fifth second."""
    if time_s < 1.5:
        return pb.MODE_TAKEOFF
    return pb.MODE_TRACK if time_s < 3.0 else pb.MODE_STOPPING if time_s < 5.0 else pb.MODE_LANDED


@pytest.mark.parametrize("landed_z_m", [0.0, 1.0, -1.5])
def test_no_acceleration_of_the_ground_is_drawn_however_high_it_landed(landed_z_m: float, tmp_path: Path) -> None:
    flight = flown(tmp_path / "x.mcap", usual, landed_z_m)
    for name in (f"{signal} {axis}" for signal in SIGNALS for axis in AXES):
        times_s, values = DERIVED[name].read(flight)
        inside = (times_s >= FLOWN_S[0] - 1e-6) & (times_s < FLOWN_S[1])
        np.testing.assert_array_equal(np.isfinite(values), inside, err_msg=name)
        assert set(values[inside]) == {0.5}, name


def test_the_reports_figure_has_nothing_of_the_ground_either(tmp_path: Path) -> None:
    report = make_report(flown(tmp_path / "x.mcap", usual))
    (figure,) = (f for f in report.figures if f.name == "disturbance")
    for table, names in (
        ("disturbance", ("desired", "attitude", "disturbance", "measured")), ("disturbance_true", ("true",)),
    ):  # fmt: skip
        for name in names:
            values = figure.tables[table][f"{name}_up_mps2"]
            assert set(values[np.isfinite(values)]) == {0.5}, name


def stepped(snap: Make, k: int, **changes: Any) -> ControlView:
    """A controller step each 50 ms, at rest."""
    control = snap().control
    assert control is not None
    still = {"vel_world_3": np.zeros(3), "stamp_ns": 1_000_000_000 + 50_000_000 * k}
    return replace(control, **{"seq": k, **still, **changes})


def at(z_m: float) -> np.ndarray:
    return np.array([0.0, 0.0, z_m])


def landed_track(snap: Make, z_m: float) -> tuple[Snapshot, Track]:
    """A vehicle that stood at 0 m, flew at 4 m and presses the ground at this height."""
    pressed = np.array([0.0, 0.0, -7.0])
    steps = [
        stepped(snap, 0, mode=pb.MODE_READY, pos_world_3=at(0.0)),
        stepped(snap, 1, mode=pb.MODE_TRACK, pos_world_3=at(4.0)),
        stepped(snap, 2, mode=pb.MODE_STOPPING, pos_world_3=at(4.0)),
        stepped(snap, 3, mode=pb.MODE_STOPPING, pos_world_3=at(z_m), acc_att_world_3=pressed),
        # The estimate of its height shakes, and its thrust is not yet cut.
        stepped(snap, 4, mode=pb.MODE_STOPPING, pos_world_3=at(z_m + 0.05), vel_world_3=np.array([0.0, 0.0, 0.4]),
                acc_att_world_3=pressed),
    ]  # fmt: skip
    snaps = [snap(control=control) for control in steps]
    return snaps[-1], Track.of(snaps)


@pytest.mark.parametrize("z_m", [0.0, 2.0, -2.0])
def test_a_landing_on_higher_or_lower_ground_ends_on_the_ground(snap: Make, z_m: float) -> None:
    standing, track = landed_track(snap, z_m)
    assert "On the ground" in panel_html(standing, track)
    commanded = track.window(60.0)[1]["commanded up"]
    np.testing.assert_array_equal(np.isfinite(commanded), [False, True, True, False, False])


def test_a_vehicle_that_falls_with_its_motors_off_is_in_the_air(snap: Make) -> None:
    falls = {"acc_att_world_3": np.array([0.0, 0.0, -9.81]), "vel_world_3": np.array([0.0, 0.0, -2.0])}
    step = stepped(snap, 1, mode=pb.MODE_STOPPING, pos_world_3=at(3.0), **falls)
    assert Ground().airborne(Step.of(step))


def test_on_the_ground_the_charts_have_their_legend(snap: Make) -> None:
    standing, track = landed_track(snap, 0.0)
    for shown, over in ((standing, track), (replace(standing, control=None), Track())):
        page = panel_html(shown, over)
        for name in ACCELERATIONS:
            assert (f"</span> {name}</span>" in page) is (name != "true"), name
    assert "</span> true</span>" in panel_html(replace(standing, truth=decode.truth(rec.truth(1.0))), track)


def handed_back(snap: Make, z_m: float) -> tuple[Snapshot, Track]:
    """A vehicle that flew, and was handed back to its autopilot at this height above where it stood."""
    modes = (pb.MODE_READY, pb.MODE_TRACK, pb.MODE_FAULT)
    heights = (0.0, 2.0, z_m)
    snaps = [
        snap(control=stepped(snap, k, mode=mode, pos_world_3=at(height)))
        for k, (mode, height) in enumerate(zip(modes, heights, strict=True))
    ]
    return snaps[-1], Track.of(snaps)


def test_a_fault_at_height_is_in_the_air_and_a_fault_where_it_stood_is_not(snap: Make) -> None:
    fault, track = handed_back(snap, 2.0)
    assert track.airborne(fault) and track.stood_z_m == 0.0
    page = panel_html(fault, track)
    assert "On the ground" not in page and "Handed back to the autopilot" in page
    assert "On the ground" in panel_html(*handed_back(snap, 0.1))


def test_after_a_fault_a_phone_shows_the_picture_and_the_battery_is_still_watched(snap: Make) -> None:
    fault, _ = handed_back(snap, 2.0)
    assert fault.health is not None and fault.control is not None
    low = replace(fault, health=replace(fault.health, battery_fraction=0.05))
    back = replace(low, control=replace(fault.control, fallback=pb.FALLBACK_HAND_BACK))
    assert low.flying
    assert "PICTURE" in phone.phone_html(low, "", "PICTURE")
    assert [alert.key for alert in alerts(back)] == ["fault", "battery"], "a hand-back is one alert"


def test_the_report_of_a_fault_in_the_air_shows_the_estimates_of_the_flight(tmp_path: Path) -> None:
    flight = flown(tmp_path / "x.mcap", lambda time_s: usual(time_s) if time_s < 3.0 else pb.MODE_FAULT)
    page = tmp_path / "x.html"
    write_page(make_report(flight), page)
    text = page.read_text(encoding="utf-8")
    estimates = text[text.index("id='estimates'") :]
    assert "At 3.00 s, the end of its task" in estimates
    assert "On the ground" not in estimates and "Handed back" not in estimates
    assert 'data-goshawk="disturbance-size">0.9 m/s' in estimates


def test_no_arrow_of_a_disturbance_is_drawn_on_the_ground(snap: Make) -> None:
    gate = Gate(host="127.0.0.1", port=0, access=Access())
    server = open_server(gate, Role.OPERATOR, "test")
    try:
        scene = LiveScene(server)
        push = np.array([0.0, 0.0, PUSH_MPS2])
        pressed = {"acc_disturbance_world_3": push, "acc_att_world_3": np.array([0.0, 0.0, -7.0])}
        for k, (mode, changes, drawn) in enumerate(
            [
                (pb.MODE_READY, {"acc_disturbance_world_3": push, "pos_world_3": at(0.0)}, False),
                (pb.MODE_TAKEOFF, {"acc_disturbance_world_3": push, "pos_world_3": at(0.1)}, False),
                (pb.MODE_TRACK, {"acc_disturbance_world_3": push, "pos_world_3": at(2.0)}, True),
                (pb.MODE_STOPPING, {"pos_world_3": at(1.0), **pressed}, False),
            ]
        ):
            scene.update(snap(control=stepped(snap, k, mode=mode, **changes)), ViewOptions())
            assert scene.disturbance.visible is drawn, mode
    finally:
        close_server(server)
        gate.close()
