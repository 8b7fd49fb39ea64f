"""The vehicle keeps its distance from who zigzags and who turns back on it: the limit is what keeps it."""

import json
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
SIM = ROOT / "target" / "release" / "goshawk-sim"
VEHICLE = ROOT / "air" / "vehicles" / "sim.toml"


def least_distances(vehicle: Path, folder: Path) -> list[float]:
    """Of each flight, m; who touched the person is among them."""
    report = folder / "flights.json"
    command = [SIM, "fly", "--task", "track", "--speed", "5", "--course", "zigzag,u-turn", "--trials", "4"]
    subprocess.run(
        [*command, "--seed", "411", "--vehicle-file", vehicle, "--json", report],
        check=True,
        capture_output=True,
        cwd=ROOT,
    )
    flights = [flight for cell in json.loads(report.read_text())["cells"] for flight in cell["flights"]]
    return [flight["min_distance_to_target_m"] for flight in flights]


def test_the_limit_keeps_the_vehicle_off_the_person(tmp_path: Path) -> None:
    kept = least_distances(VEHICLE, tmp_path)
    assert len(kept) == 8
    text = VEHICLE.read_text()
    careless = text.replace("min_target_distance_m = 2.0", "min_target_distance_m = 0.1")
    assert careless != text
    near = tmp_path / "careless.toml"
    near.write_text(careless.replace('"../models', f'"{VEHICLE.parent.parent}/models'))
    assert min(kept) > 1.5, kept
    assert min(least_distances(near, tmp_path)) < 1.0
