"""Campaigns with the real simulator and the shipped policies: the flight table and the robustness figure."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from goshawk_train import flights, robustness
from goshawk_train.cli import main
from PIL import Image

ROOT = Path(__file__).resolve().parents[3]
SIMULATOR = ROOT / "target/release/goshawk-sim"
MODELS = ROOT / "air/models"

TABLE = """
trials = 1
seed = 3

[[row]]
name = "Navigation, slow: 6 m/s"
task = "navigate"
speeds = [6]
spacings = [6]
target = 0.5
"""

SWEEPS = """
trials = 1
seed = 3

[speeds_mps]
track = 4
navigate = 6

[[sweep]]
name = "delay"
label = "odometry's delay, ms"
scale = { "odometry.delay_s" = 0.001 }
values = [0, 20]
"""


def test_the_table_is_flown_once_and_written_between_the_marks(tmp_path: Path) -> None:
    table, markdown, out = tmp_path / "t.toml", tmp_path / "R.md", tmp_path / "out"
    models = shutil.copytree(MODELS, tmp_path / "models")
    table.write_text(TABLE)
    begin, end = flights.MARKS
    markdown.write_text(f"before\n{begin}\nold\n{end}\nafter\n")
    arguments = ["flights", "--table", str(table), "--models", str(models), "--out", str(out)]
    arguments += ["--markdown", str(markdown), "--simulator"]
    assert main([*arguments, str(SIMULATOR)]) == 0
    text = markdown.read_text()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    report = json.loads((out / "navigation-slow-6-m-s.json").read_text())
    successes = f"{report['cells'][0]['successes']} of 1"
    assert successes in text
    assert successes in (models / "navigate.md").read_text()
    assert (models / "track.md").read_text() == (MODELS / "track.md").read_text()
    # What was flown is not flown again: no simulator is needed.
    assert main([*arguments, str(tmp_path / "none")]) == 0
    assert markdown.read_text() == text


def test_the_robustness_figure_shows_every_sweep(tmp_path: Path) -> None:
    sweeps, figure = tmp_path / "s.toml", tmp_path / "figure.png"
    sweeps.write_text(SWEEPS)
    arguments = ["--sweeps", str(sweeps), "--models", str(MODELS), "--out", str(tmp_path / "out")]
    assert main(["robustness", *arguments, "--simulator", str(SIMULATOR), "--figure", str(figure)]) == 0
    with Image.open(figure) as picture:
        assert picture.width > 300
    kept = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert kept == [f"delay-{task}-{value}.json" for task in ("navigate", "track") for value in (0, 20)]
    flown = json.loads((tmp_path / "out/delay-track-20.json").read_text())["flown"]["arguments"]
    assert "odometry.delay_s=0.02" in flown


def test_a_sweep_changes_an_option_or_the_sensors() -> None:
    wind = robustness.Sweep(name="wind", label="gusts", values=[5], option="--wind")
    assert wind.options(5) == ["--wind", "5"]
    noise = robustness.Sweep(name="depth", label="noise", values=[2], scale={"depth.noise_per_m": 0.0014})
    assert noise.options(2) == ["--set", "depth.noise_per_m=0.0028"]


@pytest.mark.parametrize("command", ["flights", "robustness"])
def test_a_bad_table_is_one_clear_line(command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text("trials = 'many'")
    option = "--table" if command == "flights" else "--sweeps"
    assert main([command, option, str(bad), "--out", str(tmp_path / "out")]) != 0
    assert str(bad) in capsys.readouterr().err
