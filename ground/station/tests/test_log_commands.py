"""`goshawk report`, `logs`, `export` and `recover` as an operator meets them."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import duckdb
import pytest
import recordings as rec
from goshawk_ground.cli import app
from goshawk_proto import PROTOCOL
from goshawk_proto import goshawk_pb2 as pb
from mcap_protobuf.writer import Writer
from typer.testing import CliRunner, Result

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A made-up flight."""
    return rec.write_flight(tmp_path_factory.mktemp("log") / "flight.mcap", 6.0)


@pytest.fixture
def no_log(tmp_path: Path) -> Path:
    """A file that is no log."""
    path = tmp_path / "no.mcap"
    path.write_text("hello")
    return path


def goshawk(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(a) for a in arguments])


def one_line(text: str) -> str:
    lines = text.strip().splitlines()
    assert len(lines) == 1, text
    return lines[0]


@pytest.mark.parametrize("command", ["report", "logs", "export", "recover", "doctor"])
def test_help_has_examples(command: str) -> None:
    done = goshawk(command, "--help")
    assert done.exit_code == 0
    assert f"Examples: goshawk {command}" in done.stdout


@pytest.mark.parametrize("command", [["report"], ["export", "--format", "csv"], ["recover"], ["review"]])
def test_a_file_that_is_no_log_is_one_clear_line_and_status_2(command: list[str], no_log: Path) -> None:
    for path, why in ((no_log, "is no flight log"), (no_log.with_name("absent.mcap"), "No such file")):
        done = goshawk(command[0], path, *command[1:])
        assert done.exit_code == 2
        assert why in one_line(done.stderr)


def test_of_a_folder_the_newest_log_is_taken(log: Path, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    for name, age_s in (("b", 0), ("a", 60)):
        kept = folder / name / "flight.mcap"
        kept.parent.mkdir(parents=True)
        kept.write_bytes(log.read_bytes())
        os.utime(kept, (1e9 - age_s, 1e9 - age_s))
    assert goshawk("report", folder).exit_code == 0
    assert [page.parent.name for page in folder.rglob("*.html")] == ["b"]
    (tmp_path / "empty").mkdir()
    done = goshawk("report", tmp_path / "empty")
    assert done.exit_code == 2 and "no flight logs" in one_line(done.stderr)


def test_of_a_folder_neither_an_export_nor_a_link_to_nothing_is_taken(log: Path, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    folder.mkdir()
    (folder / "flight.mcap").write_bytes(log.read_bytes())
    for format in ("foxglove", "ros2"):
        assert goshawk("export", folder, "--format", format).exit_code == 0
    (folder / "z.mcap").symlink_to(folder / "nowhere")
    (folder / "z.text.mcap").write_text("hello")
    assert goshawk("report", folder).exit_code == 0
    assert [page.name for page in folder.rglob("*.html")] == ["flight.html"]


def test_of_a_folder_without_a_header_the_newest_that_opens_is_taken(tmp_path: Path) -> None:
    headless = rec.LogFile(tmp_path / "flight.mcap")
    headless.write("control", rec.START_NS, rec.control(0.0, 0, 8.0))
    headless.close()
    (tmp_path / "z.mcap").write_text("hello")
    assert goshawk("report", tmp_path).exit_code == 0
    (tmp_path / "flight.mcap").unlink()
    assert "does not begin as an MCAP file" in one_line(goshawk("report", tmp_path).stderr)


def test_report_writes_one_page_and_tells_what_it_says(log: Path, tmp_path: Path) -> None:
    page, figures = tmp_path / "flight.html", tmp_path / "figures"
    done = goshawk("report", log, "-o", page, "--figures", figures, "--json")
    assert done.exit_code == 0, done.output
    facts = json.loads(done.stdout)
    assert facts["report"] == str(page)
    assert facts["flight"]["outcome"] == "ended: landing"
    assert facts["numbers"]["max_speed_mps"] == pytest.approx(4.47, abs=0.01)
    assert sorted(facts["figures"]) == sorted(str(p) for p in figures.iterdir())
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_report_never_writes_over_a_log(log: Path, tmp_path: Path) -> None:
    before = log.read_bytes()
    done = goshawk("report", log, "-o", log)
    assert done.exit_code == 2
    assert "let -o end in .html" in one_line(done.stderr)
    assert log.read_bytes() == before


def test_report_that_cannot_be_written_is_one_clear_line(log: Path, tmp_path: Path) -> None:
    done = goshawk("report", log, "-o", tmp_path / "nosuch" / "x.html")
    assert done.exit_code == 2
    assert "cannot write" in one_line(done.stderr)


def test_report_of_a_name_that_is_no_utf_8_is_whole_and_told_with_an_escape(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / os.fsdecode(b"a\xff.mcap")
    copy.write_bytes(log.read_bytes())
    done = goshawk("report", copy)
    assert done.exit_code == 0, done.exception
    assert "a\\udcff.html: open it in any browser" in done.stdout
    assert copy.with_suffix(".html").read_text(encoding="utf-8").rstrip().endswith("</html>")


def test_what_a_log_tells_cannot_steer_the_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "logs" / "flight.mcap"
    path.parent.mkdir()
    odd = rec.LogFile(path)
    odd.write("header", rec.START_NS, pb.LogHeader(protocol=PROTOCOL, vehicle="kite"))
    odd.write("control", rec.START_NS, rec.control(0.0, 0, 8.0))
    odd.write("event", rec.START_NS, pb.Event(severity=pb.SEVERITY_ERROR, text="\x1b]0;owned\x07\x1b[2J"))
    odd.close()
    for words in (goshawk("report", path).stdout, goshawk("logs", path.parent).stdout):
        assert "\x1b" not in words and "\x07" not in words
        assert "\\x1b]0;owned\\x07" in words


@pytest.fixture(scope="module")
def folder(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a flight, a longer one below it, an export beside it, and a file that is no log."""
    folder = tmp_path_factory.mktemp("season")
    (folder / "field").mkdir()
    (folder / "kite.mcap").write_bytes(log.read_bytes())
    rec.write_flight(folder / "field" / "longer.mcap", 7.0)
    (folder / "no.mcap").write_text("hello")
    with (folder / "kite.foxglove.mcap").open("wb") as file, Writer(file) as writer:
        writer.write_message("/tel/health", pb.Health(), log_time=1, publish_time=1)
    return folder


@pytest.fixture
def season(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same; what is known of its logs is kept from test to test."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder.parent / "cache"))
    return folder


def test_logs_lists_the_flights_of_a_folder_and_those_below_and_no_exports(season: Path) -> None:
    done = goshawk("logs", season, "--json")
    assert done.exit_code == 0
    flights = {Path(f["path"]).relative_to(season).as_posix(): f for f in json.loads(done.stdout)["flights"]}
    outcomes = {name: f["outcome"] for name, f in flights.items()}
    assert outcomes == {"kite.mcap": "ended: landing", "field/longer.mcap": "ended: landing", "no.mcap": "unreadable"}
    assert flights["no.mcap"]["damage"] == "is no flight log: it does not begin as an MCAP file"


def test_logs_gives_each_flight_one_line_of_80_columns(season: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    head, *lines = goshawk("logs", season).stdout.splitlines()
    assert head.split() == ["log", "s", "near", "m", "m/s²", "outcome", "wrong"]
    assert [line.split()[0] for line in lines] == ["no.mcap", "field/longer.mcap", "kite.mcap"]
    assert max(map(len, lines)) <= 80
    assert "ended: landing" in lines[1] and "is no flight" in lines[0]


def test_logs_shortens_a_long_name_in_its_middle(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for stamp in ("20261129-142122", "20261129-181232"):
        demo = tmp_path / "logs" / f"demo-{stamp}" / f"goshawk-2026-11-29T{stamp[9:]}193Z.mcap"
        demo.parent.mkdir(parents=True)
        demo.write_bytes(log.read_bytes())
    _, *lines = goshawk("logs", tmp_path / "logs").stdout.splitlines()
    assert [line.split()[0] for line in lines] == [
        "demo-20261129-142…T142122193Z.mcap", "demo-20261129-181…T181232193Z.mcap"
    ]  # fmt: skip
    assert max(map(len, lines)) <= 80
    assert all("ended: landing" in line for line in lines)


def test_logs_sorts_and_filters_by_any_column(season: Path) -> None:
    def names(*options: str) -> list[str]:
        flights = json.loads(goshawk("logs", season, "--json", *options).stdout)["flights"]
        return [Path(f["path"]).name for f in flights]

    assert names("--sort", "duration") == ["kite.mcap", "longer.mcap", "no.mcap"]
    assert names("--sort", "-duration") == ["longer.mcap", "kite.mcap", "no.mcap"]
    assert names("--where", "vehicle = 'kite' AND duration_s > 6.5") == ["longer.mcap"]
    assert names("--where", "damage IS NOT NULL") == ["no.mcap"]


def test_logs_writes_what_it_lists_as_parquet_and_as_a_page(season: Path, tmp_path: Path) -> None:
    table, page = tmp_path / "flights.parquet", tmp_path / "season.html"
    done = goshawk("logs", season, "--where", "duration_s > 6.5", "--parquet", table, "--report", page)
    assert done.exit_code == 0, done.output
    assert duckdb.execute(f"SELECT vehicle, round(duration_s) FROM '{table}'").fetchall() == [("kite", 7.0)]
    assert "longer.mcap" in page.read_text(encoding="utf-8")
    assert "kite.mcap" not in page.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("options", "status", "why"),
    [
        (("--where", "nosuch = 1"), 2, "the columns are path, began, vehicle"),
        (("--where", "((("), 2, "syntax error"),
        (("--sort", "nosuch"), 2, "--sort nosuch is no column: path, began"),
        (("--where", "duration_s > 1000"), 1, "for which duration_s > 1000"),
        (("--report", "season.pdf"), 2, "let --report end in .html"),
        (("--report", "/nosuch/season.html"), 2, "cannot write /nosuch/season.html"),
        (("--parquet", "flight.mcap"), 2, "let --parquet end in .parquet"),
        (("--parquet", "/nosuch/flights.parquet"), 2, "cannot write /nosuch/flights.parquet"),
    ],
)
def test_logs_says_in_one_line_what_it_cannot_do(season: Path, options: tuple[str, str], status: int, why: str) -> None:
    done = goshawk("logs", season, *options)
    assert done.exit_code == status
    assert why in one_line(done.stderr)


def test_logs_of_nothing_is_one_clear_line(tmp_path: Path) -> None:
    assert "no flight in" in one_line(goshawk("logs", tmp_path).stderr)
    assert goshawk("logs", tmp_path).exit_code == 1
    assert "is no folder" in one_line(goshawk("logs", tmp_path / "absent").stderr)
    assert goshawk("logs", tmp_path / "absent").exit_code == 2


def test_export_goes_beside_the_log_unless_told(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / "flight.mcap"
    copy.write_bytes(log.read_bytes())
    facts = json.loads(goshawk("export", copy, "--format", "foxglove", "--json").stdout)
    assert facts["path"] == str(tmp_path / "flight.foxglove.mcap")
    assert facts["counts"]["/tel/control"] == 6 * rec.CONTROL_HZ
    again = goshawk("export", copy, "--format", "foxglove")
    assert again.exit_code == 2
    assert "exists already" in one_line(again.stderr)


def test_an_export_is_no_flight_log(log: Path, tmp_path: Path) -> None:
    made = tmp_path / "x.mcap"
    assert goshawk("export", log, "--format", "ros2", "-o", made).exit_code == 0
    assert "none of its channels is Goshawk's" in one_line(goshawk("report", made).stderr)


def test_export_without_rerun_says_how_to_install_it(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    monkeypatch.delitem(sys.modules, "goshawk_dashboards.exports.rerun_file", raising=False)
    done = goshawk("export", log, "--format", "rerun", "-o", tmp_path / "x.rrd")
    assert done.exit_code == 2
    assert "make setup-rerun" in one_line(done.stderr)


def test_recover_writes_a_clean_log_and_says_which_seconds_are_missing(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = bytearray(log.read_bytes())
    data[len(data) // 2 : len(data) // 2 + 4096] = bytes(4096)
    damaged = tmp_path / "flight.mcap"
    damaged.write_bytes(data)
    words = goshawk("recover", damaged)
    assert words.exit_code == 0, words.output
    assert "damaged: " in words.stdout and " missing" in words.stdout
    clean = tmp_path / "flight.recovered.mcap"
    facts = json.loads(goshawk("recover", clean, "-o", tmp_path / "again.mcap", "--json").stdout)
    assert (facts["closed"], facts["missing"]) == (True, [])
    again = goshawk("recover", damaged)
    assert again.exit_code == 2
    assert "File exists" in one_line(again.stderr)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    listed = json.loads(goshawk("logs", tmp_path, "--json").stdout)["flights"]
    assert [Path(f["path"]).name for f in listed] == ["again.mcap", "flight.mcap"]
    damaged.unlink()
    listed = json.loads(goshawk("logs", tmp_path, "--json").stdout)["flights"]
    assert [Path(f["path"]).name for f in listed] == ["again.mcap", "flight.recovered.mcap"]
