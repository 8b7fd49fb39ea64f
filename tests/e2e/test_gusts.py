"""The disturbance observer earns its place in gusts, by what the autopilot's IMU felt: without it, what is flown lies
clearly farther from what was desired."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
from goshawk_dashboards.log.flight import Flight
from rig import BIN, ROOT, VEHICLE, copied

TRIALS = 2


def fly(vehicle_file: Path, folder: Path) -> list[Flight]:
    """Navigations in the same gusts of 5 m/s. Nothing but the trajectory is asked of the controller there; in a chase
    it keeps the view and the target's distance, too."""
    command = [BIN / "goshawk-sim", "fly", "--task", "navigate", "--vehicle-file", vehicle_file, "--speed", "4",
               "--wind", "5", "--trials", str(TRIALS), "--seed", "7", "--log", folder]  # fmt: skip
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    flights = [Flight.open(path) for path in sorted(folder.glob("*.mcap"))]
    assert len(flights) == TRIALS
    return flights


def errors(flights: list[Flight]) -> tuple[float, float]:
    """Means over what was flown, m/s²: of desired less measured, and of true less measured."""
    missed: list[np.ndarray] = []
    wrong: list[np.ndarray] = []
    for flight in flights:
        (phase,) = (p for p in flight.phases if p.name == "navigation")
        control = flight.columns("control", ["acc_des_world", "acc_meas_world"])
        flown = (control.times_s >= phase.start_s) & (control.times_s < phase.end_s)
        measured = control["acc_meas_world"][flown]
        assert np.isfinite(measured).all()
        truth = flight.columns("sim_truth", ["acc_world"])
        true = [np.interp(control.times_s[flown], truth.times_s, truth["acc_world"][:, k]) for k in range(3)]
        missed.append(control["acc_des_world"][flown] - measured)
        wrong.append(np.stack(true, axis=1) - measured)
    mean_desired, mean_true = (float(np.linalg.norm(np.concatenate(parts), axis=1).mean()) for parts in (missed, wrong))
    return mean_desired, mean_true


def unobserved(folder: Path) -> Path:
    """The simulated vehicle's file with an observer that believes in no disturbance."""
    tuning = (VEHICLE.parent / "tuning.toml").read_text()
    tuning, changed = re.subn(r"(\[observer\][^\[]*limit_mps2 = )[0-9.]+", r"\g<1>0.0", tuning)
    assert changed == 1
    (folder / "tuning.toml").write_text(tuning)
    path = folder / "sim.toml"
    path.write_text(copied().replace(f"{VEHICLE.parent}/tuning.toml", "tuning.toml"))
    return path


def test_without_the_observer_what_is_measured_is_clearly_farther_from_what_was_desired(tmp_path: Path) -> None:
    on, on_wrong = errors(fly(VEHICLE, tmp_path / "on"))
    off, off_wrong = errors(fly(unobserved(tmp_path), tmp_path / "off"))
    told = f"desired less measured: {on:.2f} m/s² with the observer, {off:.2f} without"
    print(told)
    assert off > 2.0 * on, told
    assert max(on_wrong, off_wrong) < 0.3, "the IMU does not measure the true acceleration"
