"""Campaigns with the real simulator: the flight table, the robustness figure, the ablations."""

from __future__ import annotations

import contextlib
import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command import goshawk
from goshawk_train.campaigns import ablations, flights, robustness
from goshawk_train.commands import campaign
from goshawk_train.config import load_config
from goshawk_train.model.card import FLIGHT_MARKS
from PIL import Image

ROOT = Path(__file__).resolve().parents[3]
SIMULATOR = ROOT / "target/release/goshawk-sim"
MODELS = ROOT / "air/models"
GOSHAWK = Path(sys.executable).with_name("goshawk")

TABLE = """
trials = 1

[[row]]
name = "Navigation, slow: 6 m/s"
task = "navigate"
speeds = [6]
spacings = [6]
target = 0.5
"""

SWEEPS = """
trials = 1
seed = 12_000_003

[speeds_mps]
track = 4
navigate = 6

[[sweep]]
name = "delay"
label = "odometry's delay, ms"
scale = { "odometry.delay_s" = 0.001 }
values = [0, 20]
"""


class Table:
    """A table of one row, flown into a folder, with models of its own."""

    def __init__(self, folder: Path, options: str = "") -> None:
        self.markdown, self.models = folder / "R.md", shutil.copytree(MODELS, folder / "models")
        self.kept = folder / "out/navigation-slow-6-m-s.json"
        (folder / "t.toml").write_text(f"{TABLE}options = [{options}]\n")
        begin, end = FLIGHT_MARKS
        self.markdown.write_text(f"before\n{begin}\nold\n{end}\nafter\n")
        files = ["--table", folder / "t.toml", "--models", self.models, "--out", folder / "out"]
        self.arguments = ["campaign", "flights", *files, "--markdown", self.markdown, "--simulator", SIMULATOR]

    def fly(self, *arguments: str) -> str:
        """What is written then."""
        assert goshawk(*self.arguments, *arguments).exit_code == 0
        return self.markdown.read_text()


@pytest.fixture
def the_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Table:
    """Its Markdown is the results' own."""
    table = Table(tmp_path)
    monkeypatch.setattr(campaign, "RESULTS", table.markdown)
    return table


def test_the_table_is_flown_once_and_written_between_the_marks(the_table: Table) -> None:
    table, text = the_table, the_table.fly()
    assert text.startswith("before\n") and text.endswith("after\n") and "old" not in text
    flown = table.kept.read_text()
    report = json.loads(flown)
    (cell,) = report["cells"]
    assert f"{cell['successes']} of 1" in text and f"| 6 | {cell['cruise_speed_mps']:.1f} |" in text
    assert "navigate, success: within 2 m of the goal" in text and "navigate, reached: " in text
    assert f"{cell['successes']} of 1" in (table.models / "navigate.md").read_text()
    assert (table.models / "track.md").read_text() == (MODELS / "track.md").read_text()
    # What was flown is not flown again: its timing is still the same.
    assert table.fly() == text
    assert table.kept.read_text() == flown


def test_the_tables_seed_is_in_its_range_and_comes_of_the_hashes(tmp_path: Path) -> None:
    table = Table(tmp_path)
    table.fly()
    report, now = json.loads(table.kept.read_text()), flights.present(SIMULATOR, table.models / "navigate.onnx")
    assert report["seed"] == now["table_seed"] and report["seeds"] == "table"
    assert all(report["flown"][name] == report[name] == now[name] for name in flights.HASHES)


def test_a_row_that_was_flown_with_something_else_is_stale_and_flown_again(tmp_path: Path) -> None:
    table = Table(tmp_path)
    assert "| Navigation, slow: 6 m/s | not flown yet | 6 |" in table.fly("--write-only")
    fresh = table.fly()
    flown = json.loads(table.kept.read_text())
    flown["flown"] |= {"flight_code_sha256": "0", "vehicle_sha256": "0"}
    table.kept.write_text(json.dumps(flown))
    text = table.fly("--write-only")
    assert "| Navigation, slow: 6 m/s (stale: another vehicle file, flight code) |" in text
    assert "met" not in text and "missed" not in text
    assert table.fly() == fresh


def test_a_row_from_before_the_strict_rule_says_only_what_was_reached(tmp_path: Path) -> None:
    table = Table(tmp_path)
    table.fly()
    flown = json.loads(table.kept.read_text())
    for name in ("reached", "cruise_speed_mps", "peak_speed_mps"):
        del flown["cells"][0][name]
    flown["flown"] = {"policy_sha256": "0", "arguments": []}
    del flown["rule"]
    table.kept.write_text(json.dumps(flown))
    text = table.fly("--write-only")
    of = flown["cells"][0]["successes"]
    assert f"| policy | 6 | – | – | 6 | – | – |  | {of} of 1 |" in text
    assert "(stale: another policy, vehicle file, flight code, options, rule)" in text


def test_several_pilots_fly_the_same_seeds_and_the_card_has_the_policys(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = Table(tmp_path, '"--pilot", "policy,classical"')
    monkeypatch.setattr(campaign, "RESULTS", table.markdown)
    text = table.fly()
    assert [cell["pilot"] for cell in json.loads(table.kept.read_text())["cells"]] == ["policy", "classical"]
    assert "6 m/s | policy |" in text and "6 m/s | classical |" in text
    assert "classical" not in (table.models / "navigate.md").read_text().split(FLIGHT_MARKS[0])[1]


def test_a_table_that_is_written_elsewhere_leaves_the_cards(tmp_path: Path) -> None:
    table = Table(tmp_path)
    assert "old" not in table.fly()
    assert all((table.models / card.name).read_text() == card.read_text() for card in MODELS.glob("*.md"))


def test_only_the_tasks_own_policy_on_the_default_vehicle_comes_on_its_card(tmp_path: Path) -> None:
    report = json.loads((ROOT / "ground/train/results/tracking.json").read_text())
    card = Path(shutil.copy(MODELS / "track.md", tmp_path))

    def put(name: str, model: str | None, *options: str) -> bool:
        row = flights.Row(name=name, task="track", speeds=[5], model=model, options=list(options))
        flights.put_on_card(tmp_path, "track", [flights.Kept(row=row, report=report)])
        return f"| {name} |" in card.read_text()

    assert not put("The paper's", "paper.onnx")
    assert not put("Another vehicle", None, "--vehicle-file", "air/vehicles/paper.toml")
    assert card.read_text() == (MODELS / "track.md").read_text()
    assert put("In gusts", "track.onnx", "--vehicle-file", flights.VEHICLE, "--wind", "5") and put("Tracking", None)


def test_a_table_with_a_seed_of_its_own_is_refused(tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text("seed = 3\n" + TABLE)
    with pytest.raises(flights.FlightsError, match="leave out seed"):
        flights.load(tmp_path / "t.toml")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_table_takes_its_simulator_with_it(number: signal.Signals, tmp_path: Path) -> None:
    table = tmp_path / "t.toml"
    table.write_text(TABLE.replace("trials = 1", "trials = 1000"))
    command = [str(GOSHAWK), "campaign", "flights", "--table", str(table), "--simulator", str(SIMULATOR)]
    command += ["--models", str(MODELS), "--out", str(tmp_path / "out"), "--markdown", str(tmp_path / "R.md")]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so would this
    flying = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    simulator = None
    while flying.poll() is None and simulator is None:
        time.sleep(0.05)
        simulator = next((child for child in children(flying.pid) if program(child) == FLYING), None)
    assert simulator is not None, flying.communicate()[1]
    flying.send_signal(number)
    message = flying.communicate(timeout=30)[1]
    assert flying.returncode == 130
    assert message.splitlines()[-1] == "goshawk campaign flights: interrupted; what is finished is kept"
    end = time.monotonic() + 10
    while program(simulator) == FLYING:
        assert time.monotonic() < end, "the simulator flies on"
        time.sleep(0.05)
    assert not list((tmp_path / "out").iterdir())


def test_a_signal_in_the_middle_of_a_simulators_start_waits_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[subprocess.Popen[bytes]] = []
    start = subprocess.Popen

    def interrupted(command: list[str], stdout: None) -> subprocess.Popen[bytes]:
        child = start(command, stdout=stdout)
        signal.raise_signal(signal.SIGINT)
        started.append(child)
        return child

    monkeypatch.setattr(subprocess, "Popen", interrupted)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            flights._run("a", Path("/bin/sleep"), ["60"])  # pyright: ignore[reportPrivateUsage]
    finally:
        signal.signal(signal.SIGINT, before)
    (child,) = started
    assert child.poll() == -signal.SIGKILL


def children(process: int) -> list[int]:
    """Of each of its threads; the libraries that it loads run programs of their own."""
    found: list[int] = []
    with contextlib.suppress(OSError):
        for thread in Path(f"/proc/{process}/task").iterdir():
            found += map(int, (thread / "children").read_text().split())
    return found


FLYING = [SIMULATOR.name, "fly"]


def program(process: int) -> list[str]:
    """Its name and first argument; none: it is over, or dead and nobody has asked."""
    try:
        words = Path(f"/proc/{process}/cmdline").read_bytes().decode().split("\0")
        return [Path(words[0]).name, *words[1:2]]
    except OSError:
        return []


def test_the_robustness_figure_shows_every_sweep(tmp_path: Path) -> None:
    sweeps, figure = tmp_path / "s.toml", tmp_path / "figure.png"
    sweeps.write_text(SWEEPS)
    arguments = ["--sweeps", str(sweeps), "--models", str(MODELS), "--out", str(tmp_path / "out")]
    done = goshawk("campaign", "robustness", *arguments, "--simulator", SIMULATOR, "--figure", figure)
    assert done.exit_code == 0
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


def test_a_row_in_a_scanned_world_flies_in_the_cloud(tmp_path: Path) -> None:
    row = flights.Row(name="Scanned", task="navigate", speeds=[5], scan=["--spacing", "8"])
    report = flights.fly(row, tmp_path, SIMULATOR, MODELS, trials=1, seed=10_000_003)
    assert report["cells"][0]["world"] == "scan.ply"
    assert report["flown"]["scan"] == row.scan and str(tmp_path) not in json.dumps(report["flown"]["arguments"])
    assert flights.fly(row, tmp_path, tmp_path / "none", MODELS, trials=1, seed=10_000_003) == report


PLAN = """
config = "{config}"
samples = 32
scenes = 2
frames = 16
trials = 1
seed = 1_000_004

[[campaign]]
name = "Navigation"
task = "navigate"
speeds = [6]
spacings = [6]

[[change]]
name = "none"
set = {{ "training.batch" = 32, "training.validate_frames" = 8 }}

[[change]]
name = "Half as wide, one scene"
set = {{ "network.channels" = [8, 16, 64, 128], "training.batch" = 16, "training.validate_frames" = 8 }}
scenes = 1
"""


def test_ablations_are_trained_flown_once_and_written_between_the_marks(tmp_path: Path) -> None:
    plan, markdown, out = tmp_path / "p.toml", tmp_path / "R.md", tmp_path / "out"
    plan.write_text(PLAN.format(config=ROOT / "ground/train/configs/track.toml"))
    arguments = ["campaign", "ablations", "--plan", str(plan), "--out", str(out), "--markdown", str(markdown)]
    arguments += ["--runs", str(tmp_path / "runs"), "--simulator"]
    assert goshawk(*arguments, SIMULATOR, "--only", "half-as-wide-one-scene").exit_code == 0
    assert goshawk(*arguments, SIMULATOR).exit_code == 0
    text = markdown.read_text()
    none, half = (json.loads((out / f"{name}.json").read_text()) for name in ("none", "half-as-wide-one-scene"))
    assert text.index("| none | ") < text.index("| Half as wide, one scene | ")
    assert f"{none['cells'][0]['successes']} of 1" in text
    assert half["parameters"] < none["parameters"] / 3
    assert "2 x 16 frames" in none["data"] and "1 x 16 frames" in half["data"]
    # What was trained and flown is not trained again: no simulator is needed.
    assert goshawk(*arguments, tmp_path / "none").exit_code == 0
    assert markdown.read_text() == text


def test_an_ablation_changes_a_field_that_there_is(tmp_path: Path) -> None:
    config = load_config(ROOT / "ground/train/configs/track.toml")
    changed = ablations.Change(name="x", set={"costs.clearance": 0.0}).apply(config)
    assert changed.costs.clearance == 0 and changed.training == config.training
    plan = tmp_path / "p.toml"
    text = PLAN.format(config=ROOT / "ground/train/configs/track.toml")
    for field in ("costs.clearence", "cost.clearance", "seed.of"):
        plan.write_text(text.replace("network.channels", field))
        with pytest.raises(flights.FlightsError, match=field):
            ablations.load(plan)
    plan.write_text("set = 'costs.clearance'\n" + text)
    with pytest.raises(flights.FlightsError, match="lists no ablations"):
        ablations.load(plan)
    plan.write_text("set = { 'costs.clearance' = 7.0 }\n" + text)
    assert ablations.load(plan).config.costs.clearance == 7
    plan.write_text(text)
    with pytest.raises(flights.FlightsError, match="half-as-wide-one-scene"):
        ablations.load(plan).only(["nothing"])


@pytest.mark.parametrize("command", ["flights", "robustness", "ablations"])
@pytest.mark.parametrize("text", [b"trials = 'many'", b"trials = \xff", b"sweep = 3\nspeeds_mps = 4\nrow = 5"])
def test_a_bad_table_is_one_clear_line(command: str, text: bytes, tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_bytes(text)
    option = {"flights": "--table", "robustness": "--sweeps", "ablations": "--plan"}[command]
    done = goshawk("campaign", command, option, bad, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert done.stderr.startswith(f"goshawk campaign {command}: {bad} ") and done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("trials = 1", "trials = 0", "trials must be a whole number of 1 or more"),
        ("trials = 1", "trials = true", "trials must be a whole number"),
        ("trials = 1", "trials = 1\ntrails = 2", "no key trails"),
        ("[[row]]", "[row]", "double brackets"),
        ("speeds = [6]", "speeds = []", "Navigation, slow: 6 m/s needs speeds"),
        ("speeds = [6]", "speeds = [6, 6]", "each speed and spacing once"),
        ("speeds = [6]", "speeds = 6", "speeds of Navigation, slow: 6 m/s must be a list of numbers"),
        ("target = 0.5", "target = 'half'", "target of Navigation, slow: 6 m/s must not be 'half'"),
        ("target = 0.5", "options = ['--wind', 5]", "options of Navigation, slow: 6 m/s must be a list of words"),
        ("target = 0.5", "options = ['--wind=5']", "write the option and its value as two words"),
        ("target = 0.5", TABLE.split("trials = 1")[1], "two rows of one name"),
    ],
)
def test_what_is_wrong_with_a_row_is_said(old: str, new: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "t.toml").write_text(TABLE.replace(old, new))
    with pytest.raises(flights.FlightsError, match=re.escape(said)):
        flights.load(tmp_path / "t.toml")


def test_two_changes_or_sweeps_of_one_name_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    path.write_text(PLAN.format(config=ROOT / "ground/train/configs/track.toml").replace("Half as wide, one", "None"))
    path.write_text(path.read_text().replace("None scene", "None"))
    with pytest.raises(flights.FlightsError, match="two changes of one name"):
        ablations.load(path)
    path.write_text(SWEEPS.replace("values = [0, 20]", "values = [0, 0]"))
    with pytest.raises(flights.FlightsError, match="two rows of one name"):
        robustness.load(path)


@pytest.mark.parametrize("torn", ["", '{"flown": {', "[]", "{}"])
def test_a_damaged_result_is_named_and_no_table_is_written(torn: str, tmp_path: Path) -> None:
    table = Table(tmp_path)
    table.kept.parent.mkdir()
    table.kept.write_text(torn)
    before = table.markdown.read_text()
    done = goshawk(*table.arguments)
    assert done.exit_code == 2 and done.stderr.count("\n") == 1
    assert f"{table.kept} is damaged: remove it, and run the same again" in done.stderr
    assert table.markdown.read_text() == before


def test_what_cannot_be_written_whole_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "R.md"
    path.write_text("old")
    with pytest.raises(UnicodeEncodeError):
        flights.write_whole(path, "new \ud800")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
