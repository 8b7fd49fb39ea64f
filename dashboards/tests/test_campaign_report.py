"""A campaign's page, from the JSON of a small campaign of the real simulator: slow flights succeed, fast ones fail.

They succeed and fail by so much that they do on any processor: each rounds in its own way, and flies a little
otherwise.
"""

from __future__ import annotations

import csv
import json
import re
import subprocess
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from goshawk_dashboards.report.campaign.data import OUTCOMES, Campaign, CampaignError, load
from goshawk_dashboards.report.campaign.page import page, wilson
from goshawk_dashboards.report.campaign.report import CampaignReport, make_campaign_report
from goshawk_dashboards.report.canvas import write
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
SIMULATOR = ROOT / "target/release/goshawk-sim"
CHASE = ["--task", "track", "--speed", "2,17", "--length", "100", "--trials", "2", "--seed", "2", "--moving", "1"]
NAVIGATION = ["--task", "navigate", "--pilot", "classical", "--speed", "6", "--world", "buildings", "--trials", "1"]


def fly(arguments: list[str], folder: Path) -> Path:
    """The JSON of a campaign."""
    out = folder / "flown.json"
    subprocess.run([str(SIMULATOR), "fly", *arguments, "--json", str(out)], cwd=ROOT, check=True, capture_output=True)
    return out


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A chase at two speeds."""
    return fly(CHASE, tmp_path_factory.mktemp("chase"))


@pytest.fixture(scope="module")
def report(file: Path) -> CampaignReport:
    """Worked out."""
    return make_campaign_report(load(file))


@pytest.fixture(scope="module")
def text(report: CampaignReport) -> str:
    """Its page."""
    return page(report)


def changed(file: Path, folder: Path, **parts: Any) -> Campaign:
    """The same with other parts."""
    out = folder / "changed.json"
    out.write_text(json.dumps(json.loads(file.read_text()) | parts))
    return load(out)


class Reader(HTMLParser):
    """Tags, what they would fetch, ids, and words."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.fetched: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.words = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "srcset") and not (value or "").startswith(("#", "data:")):
                self.fetched.append(value or "")
            if name == "id":
                self.ids.append(value or "")

    def handle_data(self, data: str) -> None:
        self.words += data


def test_the_page_needs_no_network_and_no_script(text: str) -> None:
    read = Reader(text)
    assert read.fetched == []
    assert not {"script", "link", "iframe", "img"} & set(read.tags)
    assert "@import" not in text and not re.search(r"url\((?!#|data:)", text)


def test_the_page_of_a_chase_has_every_figure_once(report: CampaignReport, text: str) -> None:
    names = [figure.name for figure in report.figures]
    assert names == [
        "success", "endings", "view", "distance", "speed", "closest_approach", "clearance", "in_view", "smoothness",
        "error_lateral", "error_longitudinal", "flight-1-0", "flight-1-1", "flight-0-0", "flight-0-1",
    ]  # fmt: skip
    read = Reader(text)
    assert read.tags.count("svg") == len(names)
    assert len(read.ids) == len(set(read.ids))
    assert not re.search(r"#0102[0-9a-f]{2}", text) and "nan" not in re.findall(r'[ ML"](nan|inf)[ "]', text)


def test_the_page_says_what_came_of_it_and_how_to_fly_a_failure_again(report: CampaignReport, text: str) -> None:
    words = Reader(text).words
    cells = report.campaign.file.cells
    assert [(cell.successes, cell.trials) for cell in cells] == [(2, 2), (0, 2)]
    assert "2 of 4 flights succeeded" in words and "95 % interval 15–85 %" in words
    command = " ".join(["fly", *CHASE, "--only", "1:0", "--log", "flight-1-0"])
    assert command in words and "The plain line is the target's" in words
    assert "track · forest · 2, 17 m/s, a tree every 4 m, 1 moving obstacle" in words
    for shown in report.failed:
        assert shown.row.ending in words


def test_a_cells_label_leaves_out_what_all_cells_share(report: CampaignReport) -> None:
    assert [pool.label for pool in report.campaign.pools] == ["2 m/s", "17 m/s"]
    assert report.campaign.pools[0].cell.place == "4 m, 1 moving"


def test_a_course_is_named_where_there_are_others(file: Path, tmp_path: Path) -> None:
    slow, fast = json.loads(file.read_text())["cells"]
    campaign = changed(file, tmp_path, cells=[slow, {**fast, "course": "zigzag"}], paths=[])
    assert [pool.label for pool in campaign.pools] == ["2 m/s · goal", "17 m/s · zigzag"]


def test_pilots_on_the_same_seeds_are_told_apart(file: Path, tmp_path: Path) -> None:
    slow = json.loads(file.read_text())["cells"][0]
    campaign = changed(file, tmp_path, cells=[slow, {**slow, "cell": 1, "pilot": "classical"}], paths=[])
    assert [pool.label for pool in campaign.pools] == ["2 m/s · policy", "2 m/s · classical"]
    assert [pool.cell.place for pool in campaign.pools] == ["4 m, 1 moving", "4 m, 1 moving, classical"]
    assert "track · policy and classical pilot · forest" in Reader(page(make_campaign_report(campaign))).words


def test_every_way_to_fail_is_counted_and_named(file: Path, tmp_path: Path) -> None:
    cell = json.loads(file.read_text())["cells"][0]
    flights = [{**cell["flights"][0], "trial": k, "outcome": name} for k, name in enumerate(OUTCOMES)]
    failed = {name.replace("-", "_"): 1 for name in OUTCOMES[1:]}
    cells = [{**cell, "flights": flights, "trials": len(OUTCOMES), "successes": 1, "failures": failed, "reached": 4}]
    text = page(make_campaign_report(changed(file, tmp_path, cells=cells, paths=[])))
    words = Reader(text).words
    assert "1 of 8 flights succeeded" in words and "By the lax rule 4 reached their end." in words
    for why in ("1 fell behind it", "1 had it in view too little", "1 flew too slowly", "reached"):
        assert why in words
    assert all(f"<b class='{name}'>{name}</b>" in text for name in OUTCOMES[1:])


def test_the_page_says_what_was_flown_and_what_a_success_is(report: CampaignReport, text: str) -> None:
    words = Reader(text).words
    for cell in report.campaign.file.cells:
        assert cell.cruise_speed_mps is not None and f"{cell.cruise_speed_mps:.1f}" in words
    assert "success: no contact; at the end within 10 m" in words


def test_the_interval_is_that_of_the_simulator(report: CampaignReport) -> None:
    for cell in report.campaign.file.cells:
        assert wilson(cell.successes, cell.trials) == pytest.approx(cell.success_interval)
    assert wilson(0, 0) == (0.0, 1.0)


def test_the_samples_agree_with_the_simulators_own_sums(report: CampaignReport) -> None:
    for pool in report.campaign.pools:
        for row in pool.cell.flights:
            path = pool.paths[row.trial]
            assert row.flown_speed_mps.max == pytest.approx(max(path.speed_mps), abs=0.5)
            assert row.target_distance_m is not None
            # The simulator counts until the target arrives; the path goes on while it stands.
            steps = np.linalg.norm(np.diff(path.target_S3, axis=0), axis=1)
            counted = path.distance_S[: np.flatnonzero(steps > 1e-3)[-1] + 2]
            assert row.target_distance_m.mean == pytest.approx(float(counted.mean()), rel=0.01)


def test_a_map_holds_the_whole_path_and_its_obstacles_lie_beside_it(report: CampaignReport) -> None:
    for path in report.campaign.file.paths:
        around, pos_S2 = path.map, path.pos_S3[:, :2]
        assert (pos_S2 >= around.min_m).all() and (pos_S2 <= around.max_m).all()
        corners = np.concatenate([np.array(solid) for solid in around.solids])
        assert (corners >= np.array(around.min_m) - 0.06).all() and (corners <= np.array(around.max_m) + 0.06).all()
        assert len(around.solids) > 10 and len(around.movers) == 1


def test_a_navigation_has_no_target_and_its_page_says_nothing_of_one(tmp_path: Path) -> None:
    made = make_campaign_report(load(fly(NAVIGATION, tmp_path)))
    names = {figure.name for figure in made.figures}
    assert names >= {"success", "endings", "speed", "clearance", "flight-0-0"}
    assert not names & {"view", "distance", "in_view", "error_lateral", "error_longitudinal"}
    words = Reader(page(made)).words
    assert "navigate · classical pilot · buildings · 6 m/s" in words
    assert "distance to target" not in words and "The plain line" not in words


def test_a_file_without_paths_has_figures_of_whole_flights_and_lists_its_failures(file: Path, tmp_path: Path) -> None:
    made = make_campaign_report(changed(file, tmp_path, paths=[]))
    assert [f.name for f in made.figures] == ["success", "endings", "closest_approach", "in_view", "smoothness"]
    assert len(made.failed) == 2 and made.succeeded == ()
    assert "--only 1:1" in Reader(page(made)).words


def test_results_that_the_trainer_kept_are_drawn_too() -> None:
    kept = ROOT / "ground/train/results/tracking-along-an-eight.json"
    campaign = load(kept)
    cells = campaign.file.cells
    assert f"of {sum(cell.trials for cell in cells)} flights" in Reader(page(make_campaign_report(campaign))).words


def test_failures_beyond_the_room_are_named_and_each_cell_is_shown_first(file: Path, tmp_path: Path) -> None:
    cell = json.loads(file.read_text())["cells"][1]
    many = [{**cell["flights"][0], "trial": trial} for trial in range(30)]
    cells = [{**cell, "cell": place, "flights": many, "trials": 30} for place in (0, 1)]
    made = make_campaign_report(changed(file, tmp_path, cells=cells, paths=[]))
    shown = [(flight.pool.number, flight.row.trial) for flight in made.failed]
    assert shown == [(place, trial) for place in (0, 1) for trial in range(12)]
    assert made.more[0] == "0:12" and made.more[-1] == "1:29" and len(made.more) == 36
    assert "36 more failed: 0:12, " in Reader(page(made)).words


def test_words_of_a_file_cannot_break_the_page(file: Path, tmp_path: Path) -> None:
    evil = r"<script>alert(1)</script> $\nosuch{$"
    cells = json.loads(file.read_text())["cells"]
    for cell in cells:
        cell["world"] = cell["course"] = evil
        for flight in cell["flights"]:
            flight["modes"], flight["contact"] = [evil], evil
    evil_campaign = changed(file, tmp_path, cells=cells, vehicle=evil, command=evil, version=evil, policy_sha256=evil)
    text = page(make_campaign_report(evil_campaign))
    assert "<script" not in text and text.count("&lt;script&gt;") > 10


def test_the_same_file_makes_the_same_page(file: Path, text: str) -> None:
    assert page(make_campaign_report(load(file))) == text


@pytest.mark.parametrize(
    ("contents", "why"),
    [
        ("hello", "is no campaign"),
        ("{}", "is no campaign"),
        ('{"cells": []}', "is no campaign"),
        (None, "No such file"),
    ],
)
def test_a_file_that_is_no_campaign_is_one_clear_line(contents: str | None, why: str, tmp_path: Path) -> None:
    path = tmp_path / "x.json"
    if contents is not None:
        path.write_text(contents)
    with pytest.raises(CampaignError, match=why) as raised:
        load(path)
    assert str(path) in str(raised.value) and "\n" not in str(raised.value)


def test_a_campaign_of_nothing_is_refused(file: Path, tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match="has no cells"):
        changed(file, tmp_path, cells=[])


def test_figures_are_pictures_and_tables(report: CampaignReport, tmp_path: Path) -> None:
    names = {path.name for path in write(report.figures, tmp_path / "figures")}
    assert {"success.png", "cells.csv", "endings.png", "flights.csv", "speed.csv", "flight-1-0.csv"} <= names
    assert Image.open(tmp_path / "figures/success.png").size[0] == 735

    def rows(name: str) -> list[dict[str, str]]:
        with (tmp_path / "figures" / name).open(newline="") as table:
            return list(csv.DictReader(table))

    slow, fast = rows("cells.csv")
    assert (slow["speed_mps"], slow["successes"], fast["speed_mps"], fast["successes"]) == ("2.0", "2", "17.0", "0")
    assert [row["cell"] + row["trial"] for row in rows("flights.csv")] == ["00", "01", "10", "11"]
    assert {row["unit"] for row in rows("speed.csv")} == {"m/s"}
    speeds = [float(row["speed_mps"]) for row in rows("flight-1-0.csv")]
    assert max(speeds) == max(report.campaign.pools[1].paths[0].speed_mps)
