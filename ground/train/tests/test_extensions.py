"""`goshawk campaign extensions`: what each part beyond the paper is worth, with the real simulator."""

from __future__ import annotations

import json
import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from command import goshawk
from goshawk_train.campaigns import extensions
from goshawk_train.campaigns.flights import FlightsError

ROOT = Path(__file__).resolve().parents[3]
PLAN = ROOT / "ground/train/configs/extensions.toml"
SWITCHES = set(tomllib.loads((ROOT / "air/vehicles/paper-tuning.toml").read_text())["extensions"])


def switches(vehicle: Path) -> dict[str, bool]:
    return tomllib.loads(vehicle.with_name("tuning.toml").read_text())["extensions"]


def test_every_switch_is_a_part_once_and_both_bases_fly_with_each_the_other_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(ROOT)
    plan = extensions.load(PLAN)
    parts = tomllib.loads(PLAN.read_text())["part"]
    assert sorted(name for part in parts for name in part["switches"]) == sorted(SWITCHES)
    assert any(part.get("needs") for part in parts)
    assert len(plan.variants) == 2 * (1 + len(parts))
    for base in {variant.base.name for variant in plan.variants}:
        lines = [variant for variant in plan.variants if variant.base.name == base]
        assert set(lines[0].switches.values()) == {lines[0].base.on}
        for line, part in zip(lines[1:], parts, strict=True):
            changed = {name for name, on in line.switches.items() if on != lines[0].switches[name]}
            needed: list[str] = [] if line.base.on else part.get("needs", [])
            assert changed == {*part["switches"], *needed}, line.name


def test_where_it_is_harder_each_part_is_several_of_the_same_tasks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    harder = PLAN.with_name("extensions-harder.toml")
    tasks = {part["switches"][0]: part.get("tasks") for part in tomllib.loads(PLAN.read_text())["part"]}
    parts = tomllib.loads(harder.read_text())["part"]
    for part in parts:
        assert len(part["switches"]) > 1
        assert all(tasks[name] == part.get("tasks") for name in part["switches"])
    plan = extensions.load(harder)
    assert len(plan.variants) == 1 + len(parts)
    assert plan.marks[0] in (ROOT / "ground/train/RESULTS.md").read_text()
    assert plan.seed != extensions.load(PLAN).seed


def test_a_lines_vehicle_has_its_switches_and_else_its_bases_tuning(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(ROOT)
    for variant in extensions.load(PLAN).variants:
        vehicle = variant.write(tmp_path)
        assert switches(vehicle) == variant.switches
        tuning = tomllib.loads(vehicle.with_name("tuning.toml").read_text())
        shipped = tomllib.loads((ROOT / "air/vehicles/tuning.toml").read_text())
        assert {name: table for name, table in tuning.items() if name != "extensions"} == shipped
        flown, based = (tomllib.loads(path.read_text()) for path in (vehicle, variant.base.vehicle))
        assert {**flown, "tuning": 0} == {**based, "tuning": 0}


@pytest.mark.parametrize(("task", "options"), [("track", ["--speed", "5"]), ("navigate", ["--speed", "8"])])
def test_a_part_of_the_other_task_changes_no_flight(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, task: str, options: list[str]
) -> None:
    monkeypatch.chdir(ROOT)
    whole = next(variant for variant in extensions.load(PLAN).variants if variant.name == "All")
    foreign = [p for p in tomllib.loads(PLAN.read_text())["part"] if task not in p.get("tasks", extensions.TASKS)]
    off = dict.fromkeys((name for part in foreign for name in part["switches"]), False)
    flown: list[str] = []
    for name, variant in (("with", whole), ("without", replace(whole, switches=whole.switches | off))):
        vehicle, report = variant.write(tmp_path / name), tmp_path / f"{name}.json"
        command = [str(ROOT / "target/release/goshawk-sim"), "fly", "--task", task, *options, "--trials", "2"]
        files = ["--policy", f"air/models/{task}.onnx", "--vehicle-file", str(vehicle), "--json", str(report)]
        subprocess.run([*command, *files], check=False, capture_output=True)
        flown.append(json.dumps(json.loads(report.read_text())["cells"]))
    assert len(off) >= 2 and flown[0] == flown[1]


def test_what_differs_from_the_base_is_told_with_its_luck(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    plan = extensions.load(PLAN)

    def cell(*outcomes: str) -> dict[str, Any]:
        count = outcomes.count("success")
        return {
            "trials": len(outcomes),
            "successes": count,
            "reached": count + outcomes.count("out-of-view"),
            "success_interval": [0.5, 1],
            "failures": {"collision": outcomes.count("collision")},
            "outcomes": list(outcomes),
        }

    won = cell("success", "collision", *["success"] * 5)
    base = {campaign.name: won for campaign in plan.campaigns}
    part = {name: cell("collision", "success", "out-of-view", *["lost"] * 4) for name in list(base)[:2]}
    known = {"all": extensions.Line(cells=base), "all-without-weighted-detections": extensions.Line(cells=part)}
    _, _, above, below = extensions.markdown(plan, known).splitlines()
    assert above.endswith("| 24 of 28 | 24 | 4 |  |")
    assert below.endswith("| the same | the same | 14 of 28 | 16 | 4 | -10 (2 won, 12 lost; p 0.013) |")


def test_lines_are_flown_once_and_told_against_their_base(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(ROOT)
    (tmp_path / "plan.toml").write_text(
        PLAN.read_text().split("[[campaign]]")[0]
        + '[[campaign]]\nname = "N"\ntask = "navigate"\nspeeds = [8]\nspacings = [6]\n\n'
        + "[[part]]"
        + PLAN.read_text().split("[[part]]", 1)[1]
    )
    table = tmp_path / "t.md"
    table.write_text("<!-- plan: begin -->\n<!-- plan: end -->\n")
    fly = [
        *("campaign", "extensions", "--plan", str(tmp_path / "plan.toml"), "--trials", "2"),
        *("--runs", str(tmp_path / "runs"), "--out", str(tmp_path / "out"), "--markdown", str(table)),
    ]
    lines = ["--only", "all", "--only", "all-without-no-climbing"]
    first = goshawk(*fly, *lines)
    assert first.exit_code == 0, first.stderr
    flown_ns = [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("**/*.json"))]
    kept = json.loads((tmp_path / "out/all-without-no-climbing.json").read_text())
    assert kept["identity"]["switches"]["no_climbing"] is False and len(kept["cells"]) == 1
    written = table.read_text()
    base, line = written.splitlines()[3:5]
    assert base.startswith("| All | ") and base.endswith(" |  |")
    assert line.startswith("| All, without no climbing | ") and " won, " in line and "; p " in line
    again = goshawk(*fly, "--only", "all-without-no-climbing")
    assert again.exit_code == 0 and table.read_text() == written, "what is known is told, named or not"
    assert [path.stat().st_mtime_ns for path in sorted(tmp_path.glob("**/*.json"))] == flown_ns, "flown once"
    assert len(flown_ns) == 4
    kept["identity"]["flight_code_sha256"] = "of another day"
    (tmp_path / "out/all.json").write_text(json.dumps(kept))
    assert goshawk(*fly, "--only", "all-without-no-climbing").exit_code == 0
    old, line = table.read_text().splitlines()[3:5]
    assert old.startswith("| All (stale: another flight code, switches) | "), old
    assert line.startswith("| All, without no climbing | ") and line.endswith(" |  |  |  |  |"), "they do not compare"
    kept = json.loads((tmp_path / "out/all-without-no-climbing.json").read_text())
    seeded = json.dumps(kept).replace("24000001", "24000002")
    (tmp_path / "out/all.json").write_text(seeded)
    assert goshawk(*fly, "--only", "all-without-no-climbing").exit_code == 0
    old, line = table.read_text().splitlines()[3:5]
    assert "(stale: another switches, campaigns)" in old and line.endswith(" |  |  |  |  |"), "nor do other seeds"


def test_an_unknown_line_and_a_bad_plan_are_refused_by_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(ROOT)
    with pytest.raises(FlightsError, match="no line is named nobody"):
        extensions.load(PLAN).only(["nobody"])
    (tmp_path / "bad.toml").write_text("trials = 1\n")
    refused = goshawk("campaign", "extensions", "--plan", str(tmp_path / "bad.toml"))
    assert refused.exit_code == 2 and "lists no extensions" in refused.stderr


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("trials = 200", "trials = 200\nworkers = 2", "no key workers"),
        ("speeds = [5]", "speeds = [5, 7]", "must be of one cell"),
        ('tasks = ["track"]', 'tasks = ["chase"]', "must be some of"),
        ('name = "weighted detections"', 'name = "outliers"', "two lines of one name"),
    ],
)
def test_a_plan_whose_results_would_mix_is_refused(
    old: str, new: str, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(ROOT)
    text = PLAN.read_text()
    assert old in text
    (tmp_path / "plan.toml").write_text(text.replace(old, new, 1))
    with pytest.raises(FlightsError, match=said):
        extensions.load(tmp_path / "plan.toml")


def test_campaigns_in_another_order_keep_their_own_figures(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(ROOT)
    plan = extensions.load(PLAN)
    simulator, models = ROOT / "target/release/goshawk-sim", ROOT / "air/models"
    variant = plan.variants[0]
    cells = [{"name": row.name} for row in plan.campaigns]
    kept = {"identity": extensions.identity(plan, variant, simulator, models), "cells": cells}
    (tmp_path / f"{variant.slug}.json").write_text(json.dumps(kept))
    turned = replace(plan, campaigns=plan.campaigns[::-1])
    line = extensions.kept(turned, variant, tmp_path, simulator, models)
    assert line is not None and len(line.cells) > 2
    assert all(cell["name"] == name for name, cell in line.cells.items())
