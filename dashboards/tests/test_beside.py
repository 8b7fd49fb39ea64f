"""The autopilot's own log is laid beside a flight by the motion that both hold, or refused in one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import other_logs
import pytest
from goshawk_dashboards.charts.beside import Beside, motion_of
from goshawk_dashboards.log.beside import clock, files
from goshawk_dashboards.log.beside.files import BesideError
from goshawk_dashboards.log.beside.motion import Motion
from goshawk_dashboards.log.flight import Flight

TLOG = Path(__file__).resolve().parents[2] / "tests/data/px4-sih-offboard.tlog"
FLOWN = other_logs.Flown(40.0, seed=1)


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    """40 s."""
    return Flight.open(other_logs.write_flown(tmp_path_factory.mktemp("flown") / "flight.mcap", FLOWN))


@pytest.mark.parametrize(("begin_s", "drift"), [(1234.5, 0.0), (3.25, 400e-6), (86_000.0, -900e-6)])
def test_a_known_shift_and_drift_is_found_in_a_ulog(
    flight: Flight, tmp_path: Path, begin_s: float, drift: float
) -> None:
    beside = Beside.open(other_logs.write_ulog(tmp_path / "flight.ulg", FLOWN, begin_s, drift), flight)
    assert beside.clock.begin_s == pytest.approx(begin_s, abs=2e-3)
    assert beside.clock.drift == pytest.approx(drift, abs=2e-5)
    times_s, rolls = beside.read(["vehicle_attitude.q[1]"])["vehicle_attitude.q[1]"]
    assert np.allclose(rolls, FLOWN.attitude_M4(times_s)[:, 1], atol=2e-3)
    assert beside.at("battery_status.voltage_v", 21.5) == pytest.approx(16.8 - 0.01 * 1000)
    assert "correlation 1.000" in beside.words


def test_a_tlog_is_laid_by_its_senders_clock_however_late_the_radio_was(flight: Flight, tmp_path: Path) -> None:
    beside = Beside.open(other_logs.write_tlog(tmp_path / "flight.tlog", FLOWN, 77.0, 0.0), flight)
    times_s, north = beside.read(["LOCAL_POSITION_NED.vx"])["LOCAL_POSITION_NED.vx"]
    assert np.allclose(north, FLOWN.velocity_M3(times_s)[:, 1], atol=0.03)


def test_the_log_of_a_real_px4_is_read_and_fits_itself_only(flight: Flight) -> None:
    told = files.read(TLOG)
    assert {"ATTITUDE.roll", "LOCAL_POSITION_NED.vz", "SET_ATTITUDE_TARGET@1.191.thrust"} <= set(told.signals)
    moved = {name: (times_s / (1.0 + 200e-6) + 30.0, values) for name, (times_s, values) in vars(told.motion).items()}
    found = clock.fit(told.motion, Motion(**moved))
    assert (found.begin_s, found.drift) == (pytest.approx(30.0, abs=2e-3), pytest.approx(200e-6, abs=5e-6))
    with pytest.raises(BesideError, match="is it another flight") as refused:
        Beside.open(TLOG, flight)
    assert "\n" not in str(refused.value)


def test_another_flight_a_still_one_and_one_that_repeats_itself_are_refused(flight: Flight, tmp_path: Path) -> None:
    other = other_logs.write_ulog(tmp_path / "other.ulg", other_logs.Flown(40.0, seed=2), 5.0, 0.0)
    with pytest.raises(BesideError, match="is it another flight"):
        Beside.open(other, flight)
    times_s = np.arange(0.0, 60.0, 0.02)
    still = (times_s, np.zeros(len(times_s)))
    with pytest.raises(clock.ClockError, match="do not share 5 s of motion"):
        clock.fit(motion_of(flight), Motion(tilt_deg=still, speed_mps=still))
    circle = (times_s, 5.0 + np.sin(2.0 * np.pi * times_s / 4.0))
    circling = Motion(tilt_deg=circle, speed_mps=circle)
    with pytest.raises(clock.ClockError, match="repeats itself"):
        clock.fit(circling, circling)


def test_what_is_damaged_is_read_as_far_as_it_is_whole(flight: Flight, tmp_path: Path) -> None:
    whole = other_logs.write_ulog(tmp_path / "whole.ulg", FLOWN, 9.0, 0.0).read_bytes()
    cut = tmp_path / "cut.ulg"
    cut.write_bytes(whole[: 2 * len(whole) // 3])
    beside = Beside.open(cut, flight)
    assert beside.clock.begin_s == pytest.approx(9.0, abs=2e-3)
    assert beside.clock.overlap_s < 30.0


def test_a_tlog_over_a_power_cycle_fits(flight: Flight, tmp_path: Path) -> None:
    other = other_logs.write_tlog(tmp_path / "before.tlog", other_logs.Flown(50.0, seed=3), 5.0, 0.0)
    unix_s = 1.79e9 + 60.0
    flown = other_logs.write_tlog(tmp_path / "flown.tlog", FLOWN, 5.0, 0.0, unix_s=unix_s)
    both = tmp_path / "both.tlog"
    both.write_bytes(other.read_bytes() + flown.read_bytes())
    beside = Beside.open(both, flight)
    times_s, north = beside.read(["LOCAL_POSITION_NED.vx"])["LOCAL_POSITION_NED.vx"]
    ours = (times_s >= 1.0) & (times_s <= 39.0)
    assert ours.sum() > 1800
    assert np.allclose(north[ours], FLOWN.velocity_M3(times_s[ours])[:, 1], atol=0.03)


def test_packets_out_of_turn_are_no_power_cycle(tmp_path: Path) -> None:
    flown = other_logs.Flown(40.0, seed=1)
    flown.times_s[10::10], flown.times_s[11::10] = flown.times_s[11::10].copy(), flown.times_s[10::10].copy()
    told = files.read(other_logs.write_tlog(tmp_path / "flight.tlog", flown, 77.0, 0.0))
    times_s, _ = told.signals["ATTITUDE_QUATERNION.q1"]
    assert np.allclose(np.diff(np.sort(times_s)), 1.0 / other_logs.RATE_HZ, atol=1e-3)


def test_a_ulog_is_read_without_the_message_whose_format_is_damaged(tmp_path: Path) -> None:
    path = other_logs.write_ulog(tmp_path / "flight.ulg", FLOWN, 9.0, 0.0)
    path.write_bytes(path.read_bytes().replace(b"status:uint64_t timestamp;", b"status:uint64_t timestomp;"))
    told = files.read(path)
    assert "vehicle_attitude.q[1]" in told.signals and told.flaw.startswith("damaged")
    assert not any(name.startswith("battery_status") for name in told.signals)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("notes.ulg", b"it flew well, thank you", "neither a ULog nor a tlog"),
        ("empty.tlog", b"", "neither a ULog nor a tlog"),
        ("head.ulg", b"ULog\x01\x12\x35\x01" + bytes(8), "holds no vehicle_attitude"),
        ("torn.ulg", b"ULog\x01\x12\x35", "damaged ULog"),
        ("noise.tlog", bytes(8) + b"\xfd" + bytes(range(200)), "holds no attitude"),
    ],
)
def test_what_is_no_log_of_an_autopilot_is_refused_in_one_line(
    flight: Flight, tmp_path: Path, name: str, content: bytes, says: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(BesideError, match=says) as refused:
        Beside.open(path, flight)
    assert str(path) in str(refused.value) and "\n" not in str(refused.value)
    with pytest.raises(BesideError, match="No such file"):
        Beside.open(tmp_path / "missing.ulg", flight)


def test_a_time_that_is_damaged_does_not_spoil_the_clock(flight: Flight, tmp_path: Path) -> None:
    path = other_logs.write_ulog(tmp_path / "flight.ulg", FLOWN, 1234.5, 0.0)
    content = bytearray(path.read_bytes())
    stamp = int(1254.5e6).to_bytes(8, "little")[2:]  # of about the middle, whatever its last digits
    content[content.index(stamp) + 4] ^= 1 << 5
    path.write_bytes(content)
    assert Beside.open(path, flight).clock.begin_s == pytest.approx(1234.5, abs=2e-3)


def test_two_parts_of_a_flight_that_share_no_second_are_refused() -> None:
    told = files.read(TLOG).motion
    first_s = min(times_s[0] for times_s, _ in vars(told).values())

    def part(begin_s: float, end_s: float) -> Motion:
        cut: dict[str, Any] = {}
        for name, (times_s, values) in vars(told).items():
            within = (times_s >= first_s + begin_s) & (times_s <= first_s + end_s)
            cut[name] = (times_s[within], values[within])
        return Motion(**cut)

    for ours, theirs in (((3.9, 11.9), (42.5, 50.5)), ((12.4, 20.4), (39.1, 47.1)), ((2.2, 17.2), (32.5, 47.5))):
        with pytest.raises(clock.ClockError):
            clock.fit(part(*ours), part(*theirs))
    assert clock.fit(part(5.0, 20.0), part(10.0, 25.0)).begin_s == pytest.approx(0.0, abs=0.01)
