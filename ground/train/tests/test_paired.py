"""Two campaigns on the same seeds: the statistics against textbooks, the command against flights."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from command import goshawk
from goshawk_train.cluster import paired
from goshawk_train.cluster.paired import MedianDifference, PairedError, compare, facts, words
from goshawk_train.cluster.store import Store
from goshawk_train.cluster.table import FLIGHTS, pa, parquet
from goshawk_train.rates import Rate, RateDifference
from hypothesis import given
from hypothesis import strategies as st

ROOT = Path(__file__).resolve().parents[3]
PLAN = """
trials = 10
seed = 6
seeds = "tuning"

[[row]]
name = "Dense"
task = "navigate"
speeds = [8]
spacings = [2]
options = ["--length", "30", "--vehicle-file", "{vehicle}"]
"""


def test_newcombes_interval_is_that_of_his_paper() -> None:
    # Statistics in Medicine 17 (1998), table II, method 10: 36 both, 12 only one, 2 only the other, none neither.
    low, high = RateDifference(what="", flights=50, only_a=2, only_b=12, both=36).interval
    assert (round(low, 4), round(high, 4)) == (0.0569, 0.3404)


def test_mcnemars_p_is_the_binomials() -> None:
    # 12 to 2: 2 (1 + 14 + 91) / 2^14.
    assert RateDifference(what="", flights=50, only_a=2, only_b=12, both=36).p == pytest.approx(2 * 106 / 2**14)
    assert RateDifference(what="", flights=50, only_a=0, only_b=0, both=36).p == 1.0


def test_no_collision_in_20000_flights_is_bounded_by_the_rule_of_three() -> None:
    low, high = Rate(count=0, flights=20_000).interval
    assert low == 0 and high == pytest.approx(3.69 / 20_000, rel=0.01)


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 40), st.integers(1, 40))
def test_an_interval_holds_the_difference_and_turns_with_the_sides(both: int, a: int, b: int, neither: int) -> None:
    flights = both + a + b + neither
    one = RateDifference(what="", flights=flights, only_a=a, only_b=b, both=both)
    other = RateDifference(what="", flights=flights, only_a=b, only_b=a, both=both)
    low, high = one.interval
    assert -1 <= low <= one.difference <= high <= 1
    assert other.interval == pytest.approx((-high, -low))
    assert one.p == pytest.approx(other.p)


def test_one_extension_is_compared_with_its_absence_flight_by_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    tuning = (ROOT / "air/vehicles/tuning.toml").read_text()
    assert "[extensions]" not in tuning
    without = tmp_path / "without"
    without.mkdir()
    (without / "sim.toml").write_text((ROOT / "air/vehicles/sim.toml").read_text())
    (without / "tuning.toml").write_text(f"{tuning}\n[extensions]\nobstacle_memory = false\n")
    for name, vehicle in {"a": ROOT / "air/vehicles/sim.toml", "b": without / "sim.toml"}.items():
        (tmp_path / f"{name}.toml").write_text(PLAN.replace("{vehicle}", str(vehicle)))
        done = goshawk("campaign", "run", tmp_path / f"{name}.toml", "--out", tmp_path / name)
        assert done.exit_code == 0, done.output
    words = goshawk("campaign", "compare", tmp_path / "a", tmp_path / "b")
    assert words.exit_code == 0, words.output
    assert "in 10 flights only A" in words.stdout and "(McNemar, exact)" in words.stdout
    facts = json.loads(goshawk("campaign", "compare", tmp_path / "a", tmp_path / "b", "--json").stdout)
    assert [cell["cell"] for cell in facts["cells"]] == ["Dense, navigate, 8 m/s over 30 m, 2 m, policy"]
    # It matters among trees this dense: not all flights are the same.
    (clearance,) = [m for m in facts["cells"][0]["medians"] if m["what"].startswith("least clearance")]
    assert clearance["greater"] + clearance["less"] > 0
    (same,) = compare(Store(str(tmp_path / "a")), Store(str(tmp_path / "a")))
    assert all(rate.difference == 0 and rate.p == 1 for rate in same.rates)
    assert all(isinstance(m, MedianDifference) and m.median == 0 and m.p == 1 for m in same.medians)


CELL: dict[str, Any] = {
    "row": "Dense", "pilot": "policy", "task": "track", "speed_mps": 5.0, "spacing_m": 4.0, "world": "forest",
    "evader": "planned", "course": "goal", "length_m": 40.0, "wind_mps": 0.0, "moving": 0,
}  # fmt: skip


def kept(folder: Path, *cells: dict[str, Any]) -> Store:
    """A campaign of three flights of each of these cells, which are `CELL` but for what they name."""
    flown = [
        {**CELL, **cell, "cell": place, "trial": trial, "seed": trial, "outcome": "success"}
        for place, cell in enumerate(cells)
        for trial in range(3)
    ]
    store = Store(str(folder))
    store.write("flights.parquet", parquet(pa.Table.from_pylist(flown, schema=FLIGHTS)))
    return store


def test_a_cell_is_paired_with_its_like_wherever_its_row_has_it_and_what_one_alone_flew_is_named(
    tmp_path: Path,
) -> None:
    navigates: dict[str, Any] = {"task": "navigate", "evader": None, "course": None}
    a = kept(tmp_path / "a", {"speed_mps": 5.0}, {"speed_mps": 7.0}, navigates)
    b = kept(tmp_path / "b", navigates, {"speed_mps": 7.0}, {"speed_mps": 9.0, "course": "eight"})
    made = compare(a, b)
    flights = {cell.name: [rate.flights for rate in cell.rates] for cell in made}
    assert flights == {
        "Dense, navigate, 5 m/s over 40 m, 4 m, policy": [3, 3],
        "Dense, track, 7 m/s over 40 m, 4 m, policy": [3, 3],
        "all": [6, 6],
        "Dense, track, 5 m/s over 40 m, 4 m, policy": [],
        "Dense, track, 9 m/s over 40 m, 4 m, eight, policy": [],
    }
    text = words("a", "b", made)
    assert "\nDense, track, 5 m/s over 40 m, 4 m, policy\n  left out: only A flew it" in text
    assert "\nDense, track, 9 m/s over 40 m, 4 m, eight, policy\n  left out: only B flew it" in text
    assert [fact["only"] for fact in facts(made)] == [None, None, None, "A", "B"]


@pytest.mark.parametrize(
    "other",
    [
        {"pilot": "classical"}, {"speed_mps": 7.0}, {"spacing_m": 3.0}, {"world": "buildings"},
        {"evader": "reactive"}, {"course": "eight"}, {"length_m": 80.0}, {"wind_mps": 5.0}, {"moving": 8},
    ],
    ids=lambda other: next(iter(other)),
)  # fmt: skip
def test_cells_of_the_same_place_and_seeds_are_no_pair_if_they_differ_in(other: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(PairedError, match="share no flight"):
        compare(kept(tmp_path / "a", {}), kept(tmp_path / "b", other))


def test_campaigns_of_other_seeds_or_rows_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    plain = PLAN.replace("{vehicle}", "air/vehicles/sim.toml").replace("trials = 10", "trials = 1")
    for name, text in {
        "a": plain,
        "b": plain.replace("seed = 6", "seed = 7"),
        "c": plain.replace("Dense", "Other"),
    }.items():
        (tmp_path / f"{name}.toml").write_text(text)
        assert goshawk("campaign", "run", tmp_path / f"{name}.toml", "--out", tmp_path / name).exit_code == 0
    seeds = goshawk("campaign", "compare", tmp_path / "a", tmp_path / "b")
    assert seeds.exit_code == 2 and "flew other seeds" in seeds.stderr
    rows = goshawk("campaign", "compare", tmp_path / "a", tmp_path / "c")
    assert rows.exit_code == 2 and "share no flight" in rows.stderr
    one = goshawk("campaign", "compare", tmp_path / "a")
    assert one.exit_code == 2 and "compare two campaigns" in one.stderr


def test_a_cell_that_was_flown_twice_has_no_pairs(tmp_path: Path) -> None:
    with pytest.raises(PairedError, match="was flown twice in one of the two"):
        compare(kept(tmp_path / "a", {}, {}), kept(tmp_path / "b", {}))


def test_a_campaign_of_another_version_is_named(tmp_path: Path) -> None:
    other = Store(str(tmp_path / "b"))
    other.write("flights.parquet", parquet(pa.Table.from_pylist([{"row": "Dense", "trial": 0}])))
    with pytest.raises(PairedError, match="are not of this version"):
        compare(kept(tmp_path / "a", {}), other)


def test_a_median_has_an_interval_from_six_flights_on() -> None:
    # The least and the greatest of n hold the median with 1 - 2 / 2^n: 94 % of five, 97 % of six.
    pairs: list[tuple[float | None, float | None]] = [(0.0, float(i)) for i in range(1, 7)]
    assert paired.median_difference("", pairs[:5]) is None
    six = paired.median_difference("", [*pairs, (None, 7.0)])
    assert six is not None and (six.flights, six.median, six.interval) == (6, 3.5, (1.0, 6.0))
