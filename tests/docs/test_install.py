"""The vehicle file that the page of the installation makes."""

from __future__ import annotations

import re
import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_first_vehicle_file_names_what_the_package_has_and_has_limits_for_first_flights() -> None:
    page = (ROOT / "docs/how-to/install.md").read_text(encoding="utf-8")
    (command,) = re.findall(r"^(sed .*) \| sudo tee /etc/goshawk/vehicle.toml$", page, re.MULTILINE)
    # The package has the folders of air under this name (air/deb/build.sh).
    made = command.replace("/usr/share/goshawk", str(ROOT / "air"))
    text = subprocess.run(["bash", "-c", made], check=True, capture_output=True, text=True).stdout
    file = tomllib.loads(text)
    for path in (file["tuning"], file["policy"]["model"], file["recorder"]["directory"]):
        assert Path(path).is_absolute()
    assert Path(file["tuning"]).is_file() and Path(file["policy"]["model"]).is_file()
    assert file["sensors"]["mounting"] == "checked" and file["autopilot"]["link"].startswith("serial:")
    assert file["limits"]["fence_radius_m"] <= 50 and file["limits"]["ceiling_m"] <= 10
    assert file["airframe"]["max_tilt_deg"] <= 25
