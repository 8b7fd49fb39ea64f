"""Learned against classical: from the JSON of small campaigns of the real simulator, and from changed numbers."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from goshawk_dashboards.report.campaign.data import CampaignError, Cell, Compute
from goshawk_dashboards.report.campaign.report import make_campaign_report
from goshawk_dashboards.report.canvas import Table, write
from goshawk_dashboards.report.comparison.data import METRICS, Comparison, Pair, Side, compare
from goshawk_dashboards.report.comparison.figures import comparison_figures
from goshawk_dashboards.report.comparison.page import page
from goshawk_dashboards.report.comparison.verdict import MARKS, markdown, markdown_table, put, verdict
from test_campaign_report import Reader, fly

BOTH = ["--pilot", "policy,classical", "--trials", "2", "--seed", "3"]
CHASE = ["--task", "track", "--speed", "4", "--length", "20", *BOTH]
ROUTE = ["--task", "navigate", "--speed", "6", "--length", "20", *BOTH]
Change = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A chase and a navigation by both pilots."""
    folder = tmp_path_factory.mktemp("both")
    return [fly(which, folder).rename(folder / f"{name}.json") for name, which in (("chase", CHASE), ("way", ROUTE))]


@pytest.fixture(scope="module")
def both(files: list[Path]) -> Comparison:
    return compare(files)


@pytest.fixture(scope="module")
def text(both: Comparison) -> str:
    return page(both, comparison_figures(both))


def changed(file: Path, folder: Path, change: Change, name: str = "changed") -> Path:
    """The same campaign after a change."""
    parts = json.loads(file.read_text())
    change(parts)
    out = folder / f"{name}.json"
    out.write_text(json.dumps(parts))
    return out


def cell_of(parts: dict[str, Any], pilot: str) -> dict[str, Any]:
    (cell,) = (cell for cell in parts["cells"] if cell["pilot"] == pilot)
    return cell


def duel(pair: Pair, **learned: Any) -> Comparison:
    """A comparison of a pair with one pilot's own numbers on both sides, but for those of the learned one's cell."""
    own = Side(cell=replace(pair.classical.cell, pilot="policy", **learned), compute=None)
    equal = replace(pair, learned=own, classical=replace(pair.classical, compute=None))
    return Comparison(campaigns=(pair.campaign,), pairs=(equal,), skipped=())


def clearance(pair: Pair, factor: float) -> dict[str, Any]:
    of = pair.classical.cell.clearance_m
    assert of.p5 is not None
    return {"clearance_m": replace(of, p5=factor * of.p5)}


def jerk(pair: Pair, factor: float) -> dict[str, Any]:
    of = pair.classical.cell.jerk_integral_quantiles
    assert of is not None and of.p50 is not None
    return {"jerk_integral_quantiles": replace(of, p50=factor * of.p50)}


def test_the_verdict_can_be_each_of_its_four(both: Comparison) -> None:
    pair = both.pairs[0]
    better, worse = clearance(pair, 1.5), clearance(pair, 0.5)
    assert verdict(duel(pair, **better))[0] == "The learned pilot wins"
    assert verdict(duel(pair, **worse))[0] == "The classical pilot wins"
    assert verdict(duel(pair, **better, **jerk(pair, 2.0)))[0] == "Neither pilot wins"
    assert verdict(duel(pair))[0] == "It is undecided which pilot wins"


def test_the_verdict_says_by_what_and_in_how_many_cells(both: Comparison) -> None:
    pair = both.pairs[0]
    _, rest = verdict(duel(pair, **clearance(pair, 1.5), **jerk(pair, 2.0)))
    assert rest.startswith("The learned one is better by clearance, the classical one by ∫ jerk². Both flew 1 cell ")
    assert "4 flights together" in rest
    assert "strict successes 0–0–1, clearance 1–0–0, ∫ jerk² 0–1–0, time in view 0–0–1." in rest


def test_what_is_one_percent_apart_is_a_tie(both: Comparison) -> None:
    pair = both.pairs[0]
    assert verdict(duel(pair, **clearance(pair, 1.009), **jerk(pair, 0.991)))[0] == "It is undecided which pilot wins"


def test_a_metric_needs_twice_as_many_cells_as_the_other_pilot_has(both: Comparison) -> None:
    pair = both.pairs[0]
    better, worse = (duel(pair, **clearance(pair, factor)).pairs[0] for factor in (1.5, 0.5))
    for pairs, head in (
        ((better, worse), "It is undecided which pilot wins"),
        ((better, better, worse), "The learned pilot wins"),
        ((better, worse, worse), "The classical pilot wins"),
    ):
        assert verdict(Comparison(campaigns=both.campaigns, pairs=pairs, skipped=()))[0] == head


def test_successes_are_decided_only_where_the_intervals_do_not_overlap(both: Comparison) -> None:
    pair = both.pairs[0]
    other = replace(pair.classical.cell, successes=50, trials=100, success_interval=(0.40, 0.60))
    against = replace(pair, classical=Side(cell=other, compute=None))

    def score(successes: int, interval: tuple[float, float]) -> int | None:
        cell = replace(other, successes=successes, success_interval=interval)
        return METRICS[0].better(replace(against, learned=Side(cell=cell, compute=None)))

    assert [score(65, (0.55, 0.74)), score(80, (0.71, 0.87)), score(20, (0.13, 0.29))] == [0, 1, -1]


def test_of_one_flight_nothing_is_claimed(both: Comparison) -> None:
    lone = duel(both.pairs[0], trials=1, **clearance(both.pairs[0], 1.5))
    assert lone.scores == []
    assert "none, with too few flights" in verdict(lone)[1]


def test_time_to_goal_needs_two_flights_that_reached_it(both: Comparison) -> None:
    (pair,) = both.of("navigate")
    time = METRICS[1]
    assert time.better(pair) in (-1, 0, 1)
    one = replace(pair.learned, cell=replace(pair.learned.cell, reached=1))
    assert time.better(replace(pair, learned=one)) is None


def test_compute_counts_once_a_campaign_and_a_third_is_wanted(files: list[Path], tmp_path: Path) -> None:
    def cheaper(parts: dict[str, Any]) -> None:
        totals = {compute["pilot"]: compute["total_ms"] for compute in parts["timing"]["compute"]}
        totals["policy"]["mean"] = 0.33 * totals["classical"]["mean"]
        parts["cells"] += [cell | {"speed_mps": 9.0} for cell in parts["cells"]]

    made = compare([changed(files[0], tmp_path, cheaper)])
    assert len(made.pairs) == 2
    assert (made.scores[-1].metric.name, made.scores[-1].learned) == ("compute", 1)
    assert "0.33 of the classical pilot's compute; a third at most is wanted: met." in verdict(made)[1]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("task", "navigate"), ("speed_mps", 5.0), ("spacing_m", 3.0), ("world", "buildings"), ("course", "eight"),
        ("evader", "reactive"), ("length_m", 99.0), ("wind_mps", 5.0), ("moving", 3), ("flights", []),
    ],
)  # fmt: skip
def test_cells_that_differ_in_what_decides_a_flight_are_no_pair(
    name: str, value: object, files: list[Path], tmp_path: Path
) -> None:
    def other(parts: dict[str, Any]) -> None:
        cell_of(parts, "classical")[name] = value

    with pytest.raises(CampaignError, match="nothing to compare"):
        compare([changed(files[0], tmp_path, other)])


def test_a_file_without_both_pilots_or_of_an_older_rule_is_skipped_by_its_name(
    files: list[Path], tmp_path: Path
) -> None:
    def lone(parts: dict[str, Any]) -> None:
        parts["cells"] = [cell_of(parts, "policy")]

    def old(parts: dict[str, Any]) -> None:
        del parts["rule"]

    others = [changed(files[0], tmp_path, lone, "lone"), changed(files[0], tmp_path, old, "old")]
    made = compare([*others, *files])
    assert made.skipped == ("lone.json (one pilot)", "old.json (an older rule)")
    assert len(made.pairs) == 2
    with pytest.raises(CampaignError, match=r"skipped lone.json \(one pilot\), old.json \(an older rule\)") as raised:
        compare(others)
    assert "\n" not in str(raised.value)


def test_a_file_that_is_no_campaign_ends_it_or_is_skipped_by_its_name(files: list[Path], tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text("hello")
    with pytest.raises(CampaignError, match=r"bad.json is no campaign") as raised:
        compare([tmp_path / "bad.json", *files])
    assert "\n" not in str(raised.value)
    assert compare([tmp_path / "bad.json", *files], strict=False).skipped == ("bad.json (unreadable)",)


def test_a_campaign_from_before_the_new_numbers_is_compared_by_the_others(files: list[Path], tmp_path: Path) -> None:
    def older(parts: dict[str, Any]) -> None:
        del parts["timing"]["compute"]
        for cell in parts["cells"]:
            del cell["time_to_goal_s"], cell["target_plane"]

    made = compare([changed(file, tmp_path, older, file.stem) for file in files])
    assert not {"time to goal", "compute"} & {score.metric.name for score in made.scores}
    names = {figure.name for figure in comparison_figures(made)}
    assert not {"latency", "track_target", "navigate_time"} & names and "track_success" in names


def test_the_table_has_a_line_a_pair_with_the_better_in_bold(both: Comparison, text: str) -> None:
    lines = markdown_table(both).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:4]] == ["| chase", "| way"]
    for line, pair in zip(lines[2:4], both.pairs, strict=True):
        metric = METRICS[2]
        a, b = (f"{metric.value(side):.2f}" for _, side in pair.sides)
        better = metric.better(pair)
        cell = f"{f'**{a}**' if better == 1 else a} / {f'**{b}**' if better == -1 else b}"
        assert f" | {cell} | " in line
        assert cell.replace("**", "") in Reader(text).words


def test_the_page_needs_no_network_and_has_every_figure_once(both: Comparison, text: str) -> None:
    names = [figure.name for figure in comparison_figures(both)]
    assert names == [
        "latency", "track_success", "track_failures", "track_target", "track_smoothness", "track_clearance",
        "navigate_success", "navigate_smoothness", "navigate_clearance", "navigate_time",
    ]  # fmt: skip
    read = Reader(text)
    assert read.fetched == [] and not {"script", "link", "iframe", "img"} & set(read.tags)
    assert read.tags.count("svg") == len(names) and len(read.ids) == len(set(read.ids))


def test_the_page_says_the_verdict_first_and_what_was_flown(both: Comparison, text: str) -> None:
    words = Reader(text).words
    head, rest = verdict(both)
    assert f"<h1>{head}</h1>" in text and words.index(rest) < words.index("Cell by cell") < words.index("A. Latency")
    file = both.campaigns[0].file
    assert all(part in words for part in (str(file.seed), file.vehicle_sha256[:12], file.rule.splitlines()[0]))
    assert all(part in words for part in ("66.7", "nearly 50 ms", "8.2", "no number for Elas. Tracker"))


def test_the_same_files_make_the_same_page(files: list[Path], text: str) -> None:
    again = compare(files)
    assert page(again, comparison_figures(again)) == text


def rows(table: Table) -> Iterator[dict[str, Any]]:
    for values in zip(*(column.tolist() for column in table.values()), strict=True):
        yield dict(zip(table, values, strict=True))


def test_the_figures_hold_what_the_files_hold(both: Comparison, files: list[Path]) -> None:
    tables = {name: list(rows(table)) for figure in comparison_figures(both) for name, table in figure.tables.items()}
    for file, task in zip(files, ("track", "navigate"), strict=True):
        parts = json.loads(file.read_text())
        for pilot, name in (("policy", "learned"), ("classical", "classical")):
            cell = cell_of(parts, pilot)

            def of(table: str, name: str = name) -> dict[str, Any]:
                (row,) = (row for row in tables[table] if row["pilot"] == name)
                return row

            success = of(f"{task}_success")
            assert success["share"] == 100.0 * cell["successes"] / cell["trials"]
            assert [success["low"], success["high"]] == pytest.approx([100.0 * x for x in cell["success_interval"]])
            jerks = [flight["jerk_integral"] for flight in cell["flights"]]
            assert of(f"{task}_smoothness")["p50"] == pytest.approx(float(np.median(jerks)))
            near = [flight["clearance_m"] for flight in cell["flights"]]
            assert of(f"{task}_clearance")["p50"] == pytest.approx(float(np.median(near)))
            (costs,) = (compute for compute in parts["timing"]["compute"] if compute["pilot"] == pilot)
            what = f"{name}, {'tracking' if task == 'track' else 'navigation'}"
            latency = {row["module"]: row for row in tables["latency"] if row["pilot"] == what}
            for module in ("perception", "mapping", "planning", "control", "total"):
                assert latency[module]["mean_ms"] == pytest.approx(costs[f"{module}_ms"]["mean"])
                assert latency[module]["p99_ms"] == costs[f"{module}_ms"]["p99"]
            if task == "navigate":
                assert of("navigate_time")["p50"] == cell["time_to_goal_s"]["p50"]
                assert of("navigate_time")["cruise_speed_mps"] == cell["cruise_speed_mps"]
            else:
                plane = np.array([row.split() for row in cell["target_plane"]["rows"]], dtype=int)
                heat = {
                    (r["forward_m"], r["right_m"]): r["count"] for r in tables["track_target"] if r["pilot"] == name
                }
                forward, across = np.nonzero(plane)
                expected = {(0.5 * f, 0.5 * a - 6.0): plane[f, a] for f, a in zip(forward, across, strict=True)}
                assert heat == expected and plane.sum() > 0


def test_failures_are_summed_by_kind_over_all_chases(files: list[Path], tmp_path: Path) -> None:
    def failing(parts: dict[str, Any]) -> None:
        counts = {"collision": 1, "timeout": 2, "slow": 3, "lost": 4, "out_of_view": 5, "behind": 6, "too_close": 7}
        cell_of(parts, "policy").update(successes=22, trials=50, failures=counts)

    made = compare([changed(files[0], tmp_path, failing)])
    (table,) = (figure.tables["track_failures"] for figure in comparison_figures(made) if "failures" in figure.name)
    learned = {row["ending"]: (row["flights"], row["share"]) for row in rows(table) if row["pilot"] == "learned"}
    assert learned == {
        "success": (22, 44.0), "planning failed": (6, 12.0), "target missed": (15, 30.0), "too close": (7, 14.0),
    }  # fmt: skip


def test_the_target_is_drawn_at_the_lowest_speed_and_at_seven(files: list[Path], tmp_path: Path) -> None:
    def faster(parts: dict[str, Any]) -> None:
        parts["cells"] += [cell | {"speed_mps": speed} for cell in parts["cells"] for speed in (6.0, 7.0)]

    figures = comparison_figures(compare([changed(files[0], tmp_path, faster)]))
    (table,) = (figure.tables["track_target"] for figure in figures if figure.name == "track_target")
    assert {row["speed_mps"] for row in rows(table)} == {4.0, 7.0}


def test_words_of_a_file_cannot_break_the_page(files: list[Path], tmp_path: Path) -> None:
    evil = r"<script>alert(1)</script> $\nosuch{$"

    def worse(parts: dict[str, Any]) -> None:
        parts |= {"version": evil, "policy_sha256": evil, "vehicle_sha256": evil, "rule": evil}
        for cell in parts["cells"]:
            cell["world"] = cell["course"] = evil

    made = compare([changed(files[0], tmp_path, worse, "<b>$x_{$")])
    text = page(made, comparison_figures(made))
    assert "<script" not in text and "<b>$x" not in text and text.count("&lt;script&gt;") > 5


def test_the_verdict_is_written_between_the_marks_only(both: Comparison, tmp_path: Path) -> None:
    begin, end = MARKS
    file = tmp_path / "docs.md"
    file.write_text(f"before\n{begin}\nold\n{end}\nafter\n")
    for _ in range(2):
        put(file, markdown(both, tmp_path / "pages/p.html", file))
        written = file.read_text()
        assert written.startswith(f"before\n{begin}\n**{verdict(both)[0]}.** ")
        assert written.endswith(f"[The whole comparison](pages/p.html).\n{end}\nafter\n") and "old" not in written
    file.write_text("no marks")
    with pytest.raises(CampaignError, match="lacks the marks"):
        put(file, "new")
    assert file.read_text() == "no marks"


def test_figures_are_pictures_and_tables(both: Comparison, tmp_path: Path) -> None:
    names = {path.name for path in write(comparison_figures(both), tmp_path)}
    assert {"latency.png", "latency.csv", "track_target.csv", "navigate_time.png"} <= names


def test_a_campaigns_own_page_takes_files_with_the_new_numbers(both: Comparison) -> None:
    cells: tuple[Cell, ...] = both.campaigns[0].file.cells
    computes: tuple[Compute, ...] = both.campaigns[0].file.timing.compute
    assert all(cell.target_plane is not None for cell in cells) and len(computes) == 2
    (success,) = (f for f in make_campaign_report(both.campaigns[0]).outcomes if f.name == "success")
    assert not any("rows" in column or "target_plane" in column for column in success.tables["cells"])
