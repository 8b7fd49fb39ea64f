"""`goshawk review` refuses in one line what it cannot show."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
import recordings as rec
from goshawk_ground.cli import app
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


def test_a_busy_port_is_one_clear_line_and_status_2(folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        status, line = refused(folder / "flight.mcap", "--port", taken.getsockname()[1])
    assert status == 2
    assert "choose another with --port" in line
