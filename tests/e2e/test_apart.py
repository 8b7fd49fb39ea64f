"""The vehicle keeps its distance from who zigzags and who turns back on it: the limit is what keeps it."""

import json
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
SIM = ROOT / "target" / "release" / "goshawk-sim"
VEHICLE = ROOT / "air" / "vehicles" / "sim.toml"


def least_distances(folder: Path, *arguments: str | Path, vehicle: Path = VEHICLE) -> list[float]:
    """Of each flight, m; who touched the person is among them."""
    report = folder / "flights.json"
    command = [SIM, "fly", "--task", "track", *arguments, "--vehicle-file", vehicle, "--json", report]
    subprocess.run(command, check=True, capture_output=True, cwd=ROOT)
    flights = [flight for cell in json.loads(report.read_text())["cells"] for flight in cell["flights"]]
    return [flight["min_distance_to_target_m"] for flight in flights]


def test_the_limit_keeps_the_vehicle_off_the_person(tmp_path: Path) -> None:
    flights = ("--speed", "5", "--course", "zigzag,u-turn", "--trials", "4", "--seed", "411")
    kept = least_distances(tmp_path, *flights)
    assert len(kept) == 8
    text = VEHICLE.read_text()
    careless = text.replace("min_target_distance_m = 2.0", "min_target_distance_m = 0.1")
    assert careless != text
    near = tmp_path / "careless.toml"
    for old, new in [('"../models', f'"{VEHICLE.parent.parent}/models'), ('"tuning', f'"{VEHICLE.parent}/tuning')]:
        careless = careless.replace(old, new)
    near.write_text(careless)
    assert min(kept) > 1.5, kept
    assert min(least_distances(tmp_path, *flights, vehicle=near)) < 1.0


def test_who_was_stepped_over_and_stays_below_is_not_come_down_on(tmp_path: Path) -> None:
    course = tmp_path / "below.csv"
    course.write_text("x,y,stand_s\n10,0,0\n0,0,1\n10,3,0\n-3,0,0\n")
    kept = least_distances(tmp_path, "--speed", "3", "--course", course, "--trials", "15", "--seed", "77")
    assert len(kept) == 15 and min(kept) > 1.2, kept
