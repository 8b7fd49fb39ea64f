"""`goshawk review` refuses in one line what it cannot show."""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
import recordings as rec
from goshawk_dashboards.log import progress
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.log.progress import Progress
from goshawk_dashboards.review.altering import Alteration
from goshawk_ground.cli import app
from goshawk_ground.pages.replan import replanner_of
from goshawk_ground.pages.review import open_review
from goshawk_proto import goshawk_pb2 as pb
from typer.testing import CliRunner


def refused(*arguments: object) -> tuple[int, str]:
    """The exit status and the one line of a review that does not begin."""
    done = CliRunner().invoke(app, ["review", *map(str, arguments)])
    (line,) = done.stderr.strip().splitlines()
    return done.exit_code, line


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight of two seconds, a replay of it and one of another flight."""
    folder = tmp_path_factory.mktemp("logs")
    rec.write_flight(folder / "flight.mcap", 2.0)
    rec.write_replay(folder / "replay.mcap", 2.0, chosen=3)
    rec.write_replay(folder / "stranger.mcap", 2.0, chosen=3, later_s=1e-3)
    (folder / "notes.txt").write_text("it flew well")
    return folder


def test_what_is_no_log_is_one_clear_line_and_status_2(folder: Path) -> None:
    status, line = refused(folder / "missing.mcap")
    assert (status, line) == (2, f"goshawk: cannot read {folder / 'missing.mcap'}: No such file or directory")
    status, line = refused(folder / "notes.txt")
    assert status == 2 and "is no flight log" in line
    (empty := folder / "empty").mkdir()
    assert refused(empty) == (2, f"goshawk: {empty}: no flight logs (.mcap) in this folder")


def test_logs_that_do_not_go_together_are_refused(folder: Path) -> None:
    flight, replay, stranger = (folder / f"{name}.mcap" for name in ("flight", "replay", "stranger"))
    assert "too many" in refused(*[flight] * 7)[1]
    assert "holds no flight" in refused(replay)[1]
    assert "is no replay of" in refused(flight, "--replay", stranger)[1]
    assert "is no replay of" in refused(flight, stranger)[1]
    assert "holds no flight" in refused(flight, replay, "--replay", replay)[1]


def test_a_policy_that_is_missing_and_a_log_beside_that_is_none_are_one_clear_line(folder: Path) -> None:
    flight = folder / "flight.mcap"
    status, line = refused(flight, "--policy", folder / "missing.onnx")
    assert status == 2 and "cannot read the policy" in line
    status, line = refused(flight, "--beside", folder / "notes.txt")
    assert status == 2 and "neither a ULog nor a tlog" in line


def test_a_review_that_opens_says_how_far_each_of_its_logs_is_read(folder: Path) -> None:
    told: list[tuple[str, int, int]] = []

    def hear(what: str, done: int, total: int) -> None:
        told.append((what, done, total))

    logs = [folder / "flight.mcap", folder / "replay.mcap"]
    open_review(logs[:1], logs[1], host="127.0.0.1", port=0, progress=hear).close()
    for log in logs:
        (*_, (_, done, total)) = [one for one in told if one[0] == f"reading {log.name}"]
        assert done == total > 0


def test_the_review_command_shows_a_bar_while_it_opens(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []

    @contextmanager
    def bar(**_: object) -> Generator[Progress]:
        yield lambda what, done, total: told.append(what)

    monkeypatch.setattr(progress, "progress_bar", bar)
    assert "is no replay of" in refused(folder / "flight.mcap", "--replay", folder / "stranger.mcap")[1]
    assert set(told) == {"reading flight.mcap", "reading stranger.mcap"}


def test_to_plan_again_with_the_policy_that_flew_only_the_logs_header_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = tmp_path / "flown.onnx"
    policy.write_bytes(b"a network")
    log = rec.LogFile(tmp_path / "flight.mcap")
    log.write("header", rec.START_NS, pb.LogHeader(policy_sha256=hashlib.sha256(b"a network").hexdigest()))
    log.close()
    program = tmp_path / "goshawk-air"
    program.write_text('#!/bin/sh\nfor last; do :; done\necho "{\\"asked\\": \\"$*\\"}" > "$last"\n')
    program.chmod(0o755)
    planner = replanner_of(tmp_path, [policy])
    assert planner is not None
    monkeypatch.delattr(Flight, "open")
    asked = Alteration(from_s=1.0, for_s=2.0, changes=("planner.chase.standoff_m = 8",), policy=None)
    figures = planner.replan(tmp_path / "flight.mcap", asked, tmp_path / "altered.mcap")
    assert f"--policy {policy}" in figures["asked"]


def test_a_busy_port_is_one_clear_line_and_status_2(folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        status, line = refused(folder / "flight.mcap", "--port", taken.getsockname()[1])
    assert status == 2
    assert "choose another with --port" in line
