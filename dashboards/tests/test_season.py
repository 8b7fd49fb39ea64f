"""A folder of flights: what is kept of each log, what the table answers, what the page shows."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recordings as rec
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report import summary
from goshawk_dashboards.report.report import make_report, write_page
from goshawk_dashboards.report.season import gather as gather_module
from goshawk_dashboards.report.season.figures import figures, running_median
from goshawk_dashboards.report.season.gather import gather
from goshawk_dashboards.report.season.page import page
from goshawk_dashboards.report.season.row import Row, row_of
from goshawk_dashboards.report.season.table import BY_DATE, Season
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up flight."""
    return rec.write_flight(tmp_path_factory.mktemp("log") / "flight.mcap", 8.0)


def rows(path: Path, cache: Path) -> list[Row | None]:
    return list(gather([path], cache))


def row(number: int, **facts: Any) -> Row:
    """A flight of 2 m clearance and no fault."""
    usual: dict[str, Any] = {
        "began": f"2026-05-01T{number:02}:00:00Z", "vehicle": "kite", "policy": "79a16de8", "outcome": "landed",
        "good": True, "duration_s": 60.0, "clearance_m": 2.0, "disturbance_mps2": 0.5, "fault_count": 0,
    }  # fmt: skip
    return Row(path=f"logs/{number}.mcap", **{**usual, **facts})


def test_a_row_holds_what_the_log_tells(log: Path) -> None:
    found = row_of(log)
    assert found is not None
    assert (found.vehicle, found.profile, found.outcome, found.damage) == ("kite", "chase", "ended: landing", None)
    assert (round(found.duration_s or 0.0), found.fault_count) == (8, 1)
    assert found.faults[0].startswith("fallback: ")
    # The truth is 1 + 0.8 cos t: least at t = π, while it tracks.
    assert (found.clearance_m, found.clearance_by) == (pytest.approx(0.2, abs=0.01), "truth")


def test_a_log_is_read_again_only_when_it_has_changed(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copy, cache = tmp_path / "flight.mcap", tmp_path / "cache"
    copy.write_bytes(log.read_bytes())
    before = rows(copy, cache)
    read: list[Path] = []

    def note(path: Path, _: object) -> None:
        read.append(path)

    with monkeypatch.context() as patch:
        patch.setattr(gather_module, "row_of", note)
        assert rows(copy, cache) == before == [row_like(row_of(log), copy)]
        assert not read
        copy.chmod(0o600)  # perhaps nobody could read it before
        rows(copy, cache)
        assert read == [copy]
    facts = copy.stat()
    copy.write_bytes(bytes(facts.st_size))
    os.utime(copy, ns=(facts.st_atime_ns, facts.st_mtime_ns))
    (after,) = rows(copy, cache)
    assert after is not None and after.outcome == "unreadable", "another content of the same size and time"


def test_who_waits_hears_how_far_the_reading_is(log: Path, tmp_path: Path) -> None:
    heard: list[tuple[str, int, int]] = []
    list(gather([log], tmp_path, lambda what, done, total: heard.append((what, done, total))))
    size = log.stat().st_size
    assert any(what == "reading" and 0 < done < total <= size for what, done, total in heard)
    assert heard[-1] == ("logs", 1, 1)


ODD = {
    "a date that is none": {"wall_time": "yesterday"},
    "a camera at two numbers": {"vehicle_toml": "[camera]\nposition_m = [1, 2]\ntilt_deg = 0"},
    "a camera at infinity": {"vehicle_toml": "[camera]\nposition_m = [1, 2, 3]\ntilt_deg = inf"},
    "a contract of many brackets": {"policy_contract_json": "[" * 100_000},
    "a task that is no text": {"policy_contract_json": '{"task": "\\ud800"}'},
}


def odd_log(path: Path, **header: Any) -> Path:
    """A log without the simulator's truth whose header says odd things."""
    log, noise = rec.LogFile(path), np.random.default_rng(1)
    log.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite", **header))
    for k in range(3):
        log.write("control", rec.START_NS + k * 5_000_000, rec.control(0.005 * k, k, 8.0))
        log.write("rgbd", rec.START_NS + k * 5_000_000, rec.frame(0.005 * k, k, noise))
    log.close()
    return path


@pytest.mark.parametrize("header", ODD.values(), ids=ODD.keys())
def test_a_log_whose_header_is_odd_is_listed_and_reported(header: dict[str, str], tmp_path: Path) -> None:
    path = odd_log(tmp_path / "odd.mcap", **header)
    season = Season(row for row in rows(path, tmp_path / "cache") if row is not None)
    (found,) = season.rows(BY_DATE)
    assert (found["vehicle"], found["outcome"], found["began"]) == ("kite", "ended: take-off", None)
    write_page(make_report(Flight.open(path)), tmp_path / "odd.html")


def test_a_date_is_the_tables_whatever_its_form(tmp_path: Path) -> None:
    found = row_of(odd_log(tmp_path / "odd.mcap", wall_time="20260501T100000Z"))
    assert found is not None
    assert str(Season([found]).rows()[0]["began"]) == "2026-05-01 10:00:00"


def test_a_log_whose_reading_fails_is_a_row_that_says_why(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(flight: Flight) -> None:
        raise ZeroDivisionError("division\nby zero")

    monkeypatch.setattr(summary, "healths", fails)
    assert rows(log, tmp_path) == [
        Row(path=str(log), size_bytes=log.stat().st_size, damage="makes no sense: division by zero")
    ]


def test_a_name_that_is_no_utf_8_is_listed_with_an_escape(log: Path, tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"lo\xffgs")
    folder.mkdir()
    copies = [folder / os.fsdecode(name) for name in (b"a\xff.mcap", b"b\xfe.mcap")]
    for copy in copies:
        copy.write_bytes(log.read_bytes())
    (folder / "loop.mcap").symlink_to("loop.mcap")
    paths = [*copies, folder / "loop.mcap"]
    for again in (gather(paths, tmp_path / "cache"), gather(paths, tmp_path / "cache")):
        season = Season(row for row in again if row is not None)
        assert [Path(f["path"]).name for f in season.rows("path")] == ["a\\udcff.mcap", "b\\udcfe.mcap", "loop.mcap"]
        assert "a\\udcff.mcap" in page(season, folder, folder)


def row_like(row: Row | None, path: Path) -> Row | None:
    """The same row at another place."""
    return None if row is None else replace(row, path=str(path))


def test_a_cache_that_cannot_be_written_costs_time_only(log: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    assert rows(log, tmp_path / "file" / "cache") == [row_of(log)]


def test_many_logs_are_read_by_several_processes_each_into_its_own_row(log: Path, tmp_path: Path) -> None:
    paths = [tmp_path / f"{k}.mcap" for k in range(8)]
    for path in paths:
        path.write_bytes(log.read_bytes())
    found = [r.path for r in gather(paths, tmp_path / "cache") if r is not None]
    assert found == [str(path) for path in paths]


def test_a_trend_is_the_median_of_a_flight_and_its_neighbours() -> None:
    values = [1.0, 9.0, 1.0, 1.0, 1.0, 1.0, 5.0]
    assert running_median(np.array(values)).tolist() == [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 5.0]


def test_each_vehicle_and_policy_is_one_line_and_the_rarest_share_one() -> None:
    flights = [row(k, policy=f"policy{k // 2 if k < 8 else k}") for k in range(12)]
    (clearance, *_) = figures(Season(flights).rows())
    kinds = clearance.tables["clearance"]["kind"].tolist()
    assert kinds[:8] == [f"kite policy{k // 2}" for k in range(8)]
    assert set(kinds[8:]) == {"others"}


def test_a_page_sums_up_and_needs_no_network(tmp_path: Path) -> None:
    flights = [row(k, clearance_m=2.0 - 0.1 * k) for k in range(9)]
    flights.append(row(9, outcome="collided", good=False, clearance_m=0.0, faults=("gust (2 times)",), fault_count=1))
    flights.append(Row(path="logs/short.mcap", damage="is no flight log: it holds no whole record"))
    text = page(Season(flights), Path("logs"), tmp_path)
    assert "2026-05-01 to 2026-05-01" in text
    assert re.search(r"<b>11 <small></small></b><span>flights", text)
    assert re.search(r"<b>82 <small>%</small></b><span>ended well", text)
    assert "<td data-name='fault'>gust</td><td data-name='flights' class='number'>1</td>" in text
    assert "is no flight log: it holds no whole record" in text
    assert "<code>goshawk review logs/9.mcap</code>" in text
    assert not re.search(r"<(script|link|img)|https?://(?!www\.w3\.org)", text)


def test_a_phone_has_figures_of_its_own_and_a_name_at_each_number(tmp_path: Path) -> None:
    text = page(Season([row(k) for k in range(3)]), Path("logs"), tmp_path)
    figures = re.findall(r"<figure.*?</figure>", text, re.DOTALL)
    assert len(figures) == 3
    for figure in figures:
        wide, narrow = (float(width) for width in re.findall(r'viewBox="0 0 ([0-9.]+) ', figure))
        # A phone of 390 px leaves 308 for a figure: a point is then not much less than a pixel.
        assert narrow < 390.0 < wide
        assert figure.index("<div class='narrow'>") > figure.index("<svg")
    ids = re.findall(r' id="([^"]+)"', text)
    assert len(ids) == len(set(ids))
    assert "<td data-name='clearance median, m' class='number'>2.00</td>" in text
    narrow_rules = text[text.index("@media (max-width: 600px)") :]
    assert "table.season { min-width: 0; }" in narrow_rules and "attr(data-name)" in narrow_rules


def test_a_page_leads_to_a_report_that_lies_beside_its_log(tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    (folder / "a b.html").write_text("a report")
    season = Season([Row(path=str(folder / "a b.mcap"))])
    text = page(season, folder, tmp_path)
    assert "<a href='logs/a%20b.html'>a b.mcap</a>" in text


def test_what_a_log_says_is_text_on_the_page_and_no_markup(tmp_path: Path) -> None:
    text = page(Season([row(1, vehicle="<b>kite</b>", faults=("<i>$x</i>",), fault_count=1)]), Path("logs"), tmp_path)
    assert "<b>kite" not in text and "<i>" not in text
    assert "&lt;i&gt;$x&lt;/i&gt;" in text


def test_a_damaged_cache_is_read_past(log: Path, tmp_path: Path) -> None:
    (before,) = rows(log, tmp_path)
    kept = next(tmp_path.glob("*.sqlite"))
    whole = kept.read_bytes()
    assert len(whole) > 4096
    kept.write_bytes(whole[:4096] + bytes(len(whole) - 4096))
    (now,) = rows(log, tmp_path)
    assert now == before and now is not None and now.damage is None
