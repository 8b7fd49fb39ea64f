"""Campaigns in small units with the real simulator: what is kept, what is flown again, and what comes of it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb
import pytest
from command import goshawk
from goshawk_train.cluster.store import Store

ROOT = Path(__file__).resolve().parents[3]
SIMULATOR = ROOT / "target/release/goshawk-sim"
GOSHAWK = [sys.executable, "-c", "from goshawk_ground.cli import main; main()"]
PLAN = """
trials = 6
seed = 5
seeds = "tuning"

[[row]]
name = "Navigation"
task = "navigate"
speeds = [8]
spacings = [5, 7]
options = ["--length", "10"]

[[row]]
name = "Chase in wind"
task = "track"
speeds = [5]
options = ["--length", "10", "--wind", "5"]
"""


@pytest.fixture(scope="module", autouse=True)
def _here() -> Any:
    before = Path.cwd()
    os.chdir(ROOT)
    yield
    os.chdir(before)


def plan(folder: Path, text: str = PLAN) -> Path:
    path = folder / "plan.toml"
    path.write_text(text)
    return path


def run(folder: Path, out: str | Path, *arguments: object, text: str = PLAN) -> str:
    done = goshawk("campaign", "run", plan(folder, text), "--out", out, *arguments)
    assert done.exit_code == 0, done.output
    return done.stdout


def cells_of_one_fly(folder: Path) -> dict[str, Any]:
    """By the rows' files: what `goshawk-sim fly` makes of them on one thread, in one go."""
    shared = ["--seed", "5", "--trials", "6", "--length", "10", "--threads", "1"]
    rows = {
        "navigation.json": ["navigate", "--speed", "8", "--spacing", "5,7"],
        "chase-in-wind.json": ["track", "--speed", "5", "--wind", "5"],
    }
    made: dict[str, Any] = {}
    for name, options in rows.items():
        policy = ROOT / f"air/models/{options[0]}.onnx"
        command = [SIMULATOR, "fly", "--task", *options, *shared, "--policy", policy, "--json", folder / name]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
        made[name] = json.loads((folder / name).read_text())["cells"]
    return made


def cells(out: Path) -> dict[str, Any]:
    return {path.name: json.loads(path.read_text())["cells"] for path in (out / "cells").glob("*.json")}


@pytest.fixture(scope="module")
def wanted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return cells_of_one_fly(tmp_path_factory.mktemp("fly"))


class Driver:
    """A `goshawk campaign run` in a process of its own, with a folder for what passes."""

    def __init__(self, folder: Path, out: Path) -> None:
        self.out, self.scratch = out, folder / "scratch"
        self.scratch.mkdir(exist_ok=True)
        command = [*GOSHAWK, "campaign", "run", str(plan(folder)), "--out", str(out), "--workers", "2"]
        self.process = subprocess.Popen(
            command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
            env={**os.environ, "TMPDIR": str(self.scratch)},
        )  # fmt: skip

    def after(self, units: int, number: signal.Signals) -> str:
        """Its words until that signal, which comes once so many units are finished."""
        while len(finished(self.out)) < units:
            assert self.process.poll() is None, "it ended before it was stopped"
            time.sleep(0.02)
        assert running_from(self.scratch)
        self.process.send_signal(number)
        return self.process.communicate()[1]


@dataclass(frozen=True, kw_only=True)
class Stopped:
    """A campaign that was killed without a word, gone on with, interrupted, and gone on with to its end."""

    out: Path
    interrupted: str
    status: int
    left: list[str]
    """What the interrupted one left running, or in its scratch."""
    kept: list[dict[str, int]]
    """The units that were finished at each stop."""
    words: str


@pytest.fixture(scope="module")
def stopped(tmp_path_factory: pytest.TempPathFactory) -> Stopped:
    folder = tmp_path_factory.mktemp("stopped")
    out = folder / "out"
    Driver(folder, out).after(1, signal.SIGKILL)
    kept = [finished(out)]
    # The killed one could not tidy up.
    subprocess.run(["rm", "-r", folder / "scratch"], check=True)
    second = Driver(folder, out)
    interrupted = second.after(len(kept[0]) + 1, signal.SIGINT)
    kept.append(finished(out))
    left = [*running_from(second.scratch), *map(str, second.scratch.glob("goshawk-*")), *map(str, out.rglob("*.part"))]
    words = run(folder, out, "--workers", "3")
    return Stopped(
        out=out, interrupted=interrupted, status=second.process.returncode, left=left, kept=kept, words=words
    )


@pytest.fixture(scope="module")
def flown(stopped: Stopped) -> Path:
    return stopped.out


def test_a_killed_driver_loses_only_what_was_in_flight_and_no_finished_unit_is_flown_twice(stopped: Stopped) -> None:
    now = finished(stopped.out)
    first, second = stopped.kept
    assert 1 <= len(first) < len(second) < len(now) == 6
    assert first.items() <= second.items() <= now.items()
    assert f": {sum(units_flights(stopped.out, set(now) - set(second)))} flights flown now" in stopped.words


def test_ctrl_c_is_one_line_and_leaves_nothing_behind(stopped: Stopped) -> None:
    assert stopped.status == 130
    assert stopped.interrupted.strip().splitlines()[-1].endswith("interrupted; what is finished is kept")
    assert stopped.left == []


def units_flights(out: Path, names: set[str]) -> list[int]:
    return [ask(f"select count(*) from '{out}/units/{name}'").fetchall()[0][0] for name in names]


def ask(question: str) -> Any:
    """Plain DuckDB's answer."""
    return duckdb.sql(question)


def finished(out: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (out / "units").glob("*.parquet")}


def test_the_cells_of_a_campaign_that_was_stopped_twice_are_those_of_one_fly_bit_for_bit(
    flown: Path, wanted: dict[str, Any]
) -> None:
    assert sorted(wanted) == ["chase-in-wind.json", "navigation.json"]
    assert cells(flown) == wanted


def test_what_is_flown_is_not_flown_again_and_more_trials_fly_only_what_is_new(flown: Path, tmp_path: Path) -> None:
    before = finished(flown)
    words = run(tmp_path, flown)
    assert finished(flown) == before
    assert words.splitlines()[-1].startswith(f"{flown}/flights.parquet: 0 flights flown now")
    out = tmp_path / "few"
    run(tmp_path, out, "--trials", "5", text=PLAN.replace("trials = 6", "trials = 1"))
    few = finished(out)
    assert len(few) == 3 and set(few) < set(before)


def test_plain_duckdb_opens_the_parquet_and_finds_a_row_a_flight(flown: Path, wanted: dict[str, Any]) -> None:
    counted = ask(
        f"select row, cell, count(*), count(*) filter (success), count(distinct seed), bool_and(core_s > 0) "
        f"from '{flown}/flights.parquet' group by all order by all"
    ).fetchall()
    cells = [("Chase in wind", cell) for cell in wanted["chase-in-wind.json"]]
    cells += [("Navigation", cell) for cell in wanted["navigation.json"]]
    assert counted == [(row, cell["cell"], 6, cell["successes"], 6, True) for row, cell in cells]


def test_a_query_shows_duckdbs_answer_and_a_wrong_one_is_one_line(flown: Path) -> None:
    asked = goshawk("campaign", "query", "select count(*) as flown from flights", "--campaign", flown)
    assert asked.exit_code == 0 and "flown" in asked.stdout and "18" in asked.stdout
    wrong = goshawk("campaign", "query", "select colour from flights", "--campaign", flown)
    assert wrong.exit_code == 2 and len(wrong.stderr.splitlines()) == 1 and "colour" in wrong.stderr
    row = goshawk("campaign", "query", "select\n cast(row as int) from flights", "--campaign", flown)
    assert row.exit_code == 2 and len(row.stderr.splitlines()) == 1 and "select cast(row as int)" in row.stderr
    nothing = goshawk("campaign", "query", "select 1", "--campaign", flown / "nowhere")
    assert nothing.exit_code == 2 and "holds no finished campaign" in nothing.stderr


def test_the_summary_has_each_cells_rates_with_their_intervals(flown: Path, tmp_path: Path) -> None:
    *lines, _ = run(tmp_path, flown).splitlines()
    flights = ["Chase in wind, 5 m/s, 4 m: 6", "Navigation, 8 m/s, 5 m: 6", "Navigation, 8 m/s, 7 m: 6", "all: 18"]
    assert [line.split(" flights, ")[0] for line in lines] == flights
    assert all("success" in line and "flights per core-hour" in line for line in lines)


def test_the_report_draws_the_cells_of_a_campaigns_folder(flown: Path, tmp_path: Path) -> None:
    done = goshawk("campaign", "report", flown, "--out", tmp_path)
    assert done.exit_code == 0
    assert {path.name for path in tmp_path.glob("*.html")} == {"chase-in-wind.html", "navigation.html"}


def test_the_worst_flights_are_the_same_flights_again_with_logs_to_review(flown: Path) -> None:
    done = goshawk("campaign", "worst", "-n", 2, "--campaign", flown)
    assert done.exit_code == 0, done.output
    worst = ask(
        f"select row, cell, trial, outcome from '{flown}/flights.parquet' "
        "order by success, outcome <> 'collision', clearance_m nulls last, row, cell, trial limit 2"
    ).fetchall()
    lines = done.stdout.splitlines()
    for line, (row, cell, trial, outcome) in zip(lines, worst, strict=True):
        assert line.startswith(f"{row} {cell}:{trial} {outcome}")
        log = Path(line.rsplit(" ", 1)[1])
        facts = goshawk("report", log, "--json")
        assert facts.exit_code == 0, facts.output
        # The log tells the same end as the campaign.
        assert log.parent == flown / "logs" and log.read_bytes()[1:5] == b"MCAP"
        assert json.loads(facts.stdout)["flight"]["outcome"].startswith(outcome)


def test_a_flight_that_is_another_one_again_is_refused(flown: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    subprocess.run(["cp", "-r", flown, copy], check=True)
    for path in (copy / "units").glob("*.parquet"):
        changed = ask(f"select * replace (replace(record, '\"trial\":', '\"trial\": ') as record) from '{path}'")
        changed.write_parquet(str(path))
    refused = goshawk("campaign", "worst", "-n", 1, "--campaign", copy)
    assert refused.exit_code == 2 and "is another flight on this machine" in refused.stderr


@pytest.mark.parametrize(("name", "said"), [("plan.json", "is no file of a campaign"), ("flights.parquet", "damaged")])
def test_a_damaged_file_of_a_campaign_is_named(name: str, said: str, flown: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    subprocess.run(["cp", "-r", flown, copy], check=True)
    for text in ("[]", "{}"):
        (copy / name).write_text(text)
        refused = goshawk("campaign", "worst", "-n", 1, "--campaign", copy)
        assert refused.exit_code == 2 and refused.stderr.count("\n") == 1
        assert said in refused.stderr and str(copy / name) in refused.stderr


def test_the_worst_of_a_campaign_that_had_fewer_trials_first_is_found_in_its_unit(tmp_path: Path) -> None:
    out = tmp_path / "out"
    row = PLAN[: PLAN.rindex("[[row]]")].replace("[5, 7]", "[5]")
    for trials in (2, 3):
        run(tmp_path, out, "--trials", trials, text=row)
    done = goshawk("campaign", "worst", "-n", 3, "--campaign", out)
    assert done.exit_code == 0 and len(done.stdout.splitlines()) == 3, done.output


def test_a_plan_of_which_nothing_was_flown_may_change(tmp_path: Path) -> None:
    out = tmp_path / "out"
    refused = goshawk("campaign", "run", plan(tmp_path, PLAN.replace('"10"', '"-1"')), "--out", out)
    assert refused.exit_code == 2 and "--length" in refused.stderr and "--help" not in refused.stderr
    run(tmp_path, out, "--trials", 1)


def test_another_plan_or_another_policy_needs_another_folder(flown: Path, tmp_path: Path) -> None:
    other = plan(tmp_path, PLAN.replace("speeds = [5]", "speeds = [6]"))
    refused = goshawk("campaign", "run", other, "--out", flown)
    assert refused.exit_code == 2 and "another plan" in refused.stderr and "give another --out" in refused.stderr
    models = tmp_path / "models"
    models.mkdir()
    for task in ("track", "navigate"):
        (models / f"{task}.onnx").write_bytes(
            (ROOT / f"air/models/{task}.onnx").read_bytes() + b"\0" * (task == "track")
        )
    refused = goshawk("campaign", "run", plan(tmp_path), "--out", flown, "--models", models)
    assert refused.exit_code == 2 and "another simulator, policy" in refused.stderr


def test_a_processor_that_computes_otherwise_is_refused_and_named(tmp_path: Path) -> None:
    out = tmp_path / "out"
    run(tmp_path, out, "--trials", "1")
    first = json.loads((out / "processor.json").read_text())
    first |= {"flight_sha256": "0" * 64, "node": "elsewhere", "model": "Abacus 9"}
    (out / "processor.json").write_text(json.dumps(first))
    refused = goshawk("campaign", "run", plan(tmp_path), "--out", out, "--trials", "6")
    assert refused.exit_code == 2 and len(refused.stderr.strip().splitlines()[-1:]) == 1
    assert "elsewhere (Abacus 9" in refused.stderr and "differ in floating point" in refused.stderr


def running_from(folder: Path) -> list[str]:
    """Programs of that folder that run."""
    found: list[str] = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            found.append(str((process / "exe").readlink()))
    return [program for program in found if program.startswith(str(folder))]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("trials = 1", "is no plan"),
        (PLAN.replace("trials = 6", "trials = 0"), "trials must be a whole number of 1 or more"),
        (PLAN.replace("seed = 5", "seed = -5"), "seed must be a whole number of 0 or more"),
        (PLAN.replace('"tuning"', '"free"'), "seeds must be table or tuning, not 'free'"),
        ("row = []\n" + PLAN.split("[[row]]")[0], "nothing to fly"),
        (PLAN + "[other]\n", "it has no key other"),
        (PLAN.replace("Chase in wind", "Navigation"), "two rows of one name"),
        (PLAN.replace('"--wind", "5"', '"--autopilot", "px4"'), "firmware flies with goshawk-sim fly only"),
        (PLAN.replace('"--wind", "5"', '"--course", "moon"'), "moon"),
    ],
)
def test_a_plan_that_cannot_be_flown_is_refused_in_one_line(tmp_path: Path, text: str, words: str) -> None:
    refused = goshawk("campaign", "run", plan(tmp_path, text), "--out", tmp_path / "out")
    assert refused.exit_code == 2 and words in refused.stderr.strip().splitlines()[-1]


def test_an_address_that_nobody_knows_is_one_line() -> None:
    refused = goshawk("campaign", "query", "select 1", "--campaign", "moon://base")
    assert refused.exit_code == 2 and len(refused.stderr.splitlines()) == 1


def test_campaigns_need_no_torch() -> None:
    names = ["plan", "kit", "worker", "store", "table", "engines", "run", "query", "paired", "worst"]
    code = "import sys\n" + "\n".join(f"import goshawk_train.cluster.{name}" for name in names)
    code += "\nassert 'torch' not in sys.modules and 'ray' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_campaign_at_s3_is_the_same_campaign(flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    for name, value in {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "a",
        "AWS_SECRET_ACCESS_KEY": "b",
        "AWS_DEFAULT_REGION": "us-east-1",
    }.items():
        monkeypatch.setenv(name, value)
    try:
        there = Store("s3://flights/night")
        there.fs.mkdir("flights")
        for name in ("plan.json", "processor.json", *(f"units/{unit}" for unit in finished(flown))):
            there.write(name, (flown / name).read_bytes())
        lost = sorted(finished(flown))[0]
        there.fs.rm(there.path(f"units/{lost}"))
        assert "flights flown now" in run(tmp_path, there.address)
        assert there.names("units") == set(finished(flown))
        for name in ("navigation.json", "chase-in-wind.json"):
            assert there.read_json(f"cells/{name}")["cells"] == cells(flown)[name]
        asked = goshawk("campaign", "query", "select count(*) from flights", "--campaign", there.address)
        assert asked.exit_code == 0 and "18" in asked.stdout
        done = goshawk("campaign", "worst", "-n", 1, "--campaign", there.address)
        assert done.exit_code == 0 and there.names("logs") == {done.stdout.strip().rsplit("/", 1)[1]}
        same = goshawk("campaign", "compare", there.address, flown)
        assert same.exit_code == 0 and "only A 0, only B 0" in same.stdout
    finally:
        server.stop()
