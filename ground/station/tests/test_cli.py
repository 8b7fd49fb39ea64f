"""The command line as an operator meets it: a process, its words, its exit status."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from goshawk_ground.cli import app
from goshawk_ground.commands.options import print_json
from typer.testing import CliRunner

Fakes = Callable[..., Any]


def goshawk(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def one_line(text: str) -> str:
    lines = text.strip().splitlines()
    assert len(lines) == 1, text
    return lines[0]


@pytest.mark.parametrize("command", ["start", "status"])
def test_no_vehicle_is_one_clear_line_and_status_2(command: str, free_endpoint: str) -> None:
    done = goshawk(command, "--connect", free_endpoint, "--timeout", "0.5")
    assert done.returncode == 2
    assert done.stdout == ""
    line = one_line(done.stderr)
    assert line.startswith(f"goshawk: no vehicle at {free_endpoint}")


def test_a_stop_that_is_given_up_tells_the_pilot_what_to_do_and_is_status_2(free_endpoint: str) -> None:
    done = goshawk("stop", "--connect", free_endpoint, "--timeout", "0.5")
    assert (done.returncode, done.stdout) == (2, "")
    line = one_line(done.stderr)
    assert line == f"goshawk: Stop not delivered. Pilot: take over. There is no link to {free_endpoint}."


@pytest.mark.parametrize("command", ["start", "stop", "status", "ground"])
def test_a_bad_endpoint_is_one_clear_line_and_status_2(command: str) -> None:
    done = CliRunner().invoke(app, [command, "--connect", "nonsense"])
    assert done.exit_code == 2
    assert "'nonsense' is not an endpoint" in one_line(done.stderr)


@pytest.mark.parametrize("command", ["start", "stop", "status", "ground", "demo", "review"])
def test_help_has_examples(command: str) -> None:
    done = CliRunner().invoke(app, [command, "--help"])
    assert done.exit_code == 0
    assert f"goshawk {command}" in done.stdout
    assert "Examples:" in done.stdout


def test_start_and_stop_say_what_became_of_them(fake_vehicle: Fakes) -> None:
    endpoint = fake_vehicle().endpoint
    status = ""
    while "ready, ready" not in status:
        status = goshawk("status", "--connect", endpoint).stdout
    started = goshawk("start", "--connect", endpoint)
    assert (started.returncode, one_line(started.stdout)) == (0, "start accepted (takeoff): taking off")
    again = goshawk("start", "--connect", endpoint)
    assert again.returncode == 1
    assert "already flying" in one_line(again.stderr)
    stopped = goshawk("stop", "--connect", endpoint, "--json")
    facts = json.loads(stopped.stdout)
    assert stopped.returncode == 0
    assert (facts["accepted"], facts["mode"]) == (True, "stopping")


def test_an_unknown_profile_is_refused_with_the_vehicles_words(fake_vehicle: Fakes) -> None:
    endpoint = fake_vehicle().endpoint
    while '"ready": true' not in goshawk("status", "--connect", endpoint, "--json").stdout:
        pass
    done = goshawk("start", "--profile", "nosuch", "--connect", endpoint)
    assert done.returncode == 1
    assert "no profile named 'nosuch'" in one_line(done.stderr)


def test_status_of_a_vehicle_that_is_not_ready_says_why_and_is_1(fake_vehicle: Fakes) -> None:
    endpoint = fake_vehicle("--not-ready").endpoint
    done = goshawk("status", "--connect", endpoint)
    assert done.returncode == 1
    assert "no odometry yet" in done.stdout
    assert "planner" in done.stdout
    facts = json.loads(goshawk("status", "--connect", endpoint, "--json").stdout)
    assert facts["ready"] is False
    assert {c["name"] for c in facts["checks"] if not c["ok"]} == {"odometry"}


def test_a_busy_dashboard_port_is_one_clear_line(free_endpoint: str) -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        done = goshawk("ground", "--connect", free_endpoint, "--port", port)
    assert done.returncode == 2
    assert f"127.0.0.1:{port}" in one_line(done.stderr)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("start", "--timeout", "inf"), "or equal to"),
        (("stop", "--timeout", "nan"), "or equal to"),
        (("start", "--profile", os.fsdecode(b"ch\xe4se")), "not plain text"),
        (("ground", "--host", "bad..name"), "no address is called so"),
        (("ground", "--vehicle", "a", "--vehicle", "b", "--foxglove", "65535"), "ports up to 65536"),
    ],
)
def test_arguments_that_mean_nothing_are_refused_with_their_reason(
    arguments: tuple[str, ...], words: str, free_endpoint: str
) -> None:
    done = goshawk(*arguments, "--connect", free_endpoint)
    assert (done.returncode, done.stdout) == (2, "")
    assert words in " ".join(done.stderr.split()), done.stderr
    assert "Traceback" not in done.stderr


def test_a_number_that_is_none_is_null_in_json(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": math.nan, "b": [1.5, (math.inf,)], "c": Path("x")})
    assert json.loads(capsys.readouterr().out) == {"a": None, "b": [1.5, [None]], "c": "x"}


def test_an_unknown_option_is_wrong_usage() -> None:
    assert CliRunner().invoke(app, ["start", "--nosuch"]).exit_code == 2


@pytest.mark.parametrize(
    "command",
    ["train run", "train validate", "train score", "train preview", "train export", "train bench", "dataset check",
     "dataset import", "campaign report", "campaign compare", "campaign flights", "campaign robustness",
     "campaign ablations"],
)  # fmt: skip
def test_the_trainers_commands_have_help_with_examples(command: str) -> None:
    group, name = command.split()
    assert name in CliRunner().invoke(app, [group, "--help"]).stdout
    done = CliRunner().invoke(app, [group, name, "--help"])
    assert done.exit_code == 0
    assert f"goshawk {command}" in done.stdout.partition("Example")[2]


def test_the_trainers_words_and_status_come_through(tmp_path: Path) -> None:
    done = goshawk("dataset", "check", str(tmp_path))
    assert done.returncode == 2
    assert one_line(done.stderr).startswith(f"goshawk dataset check: {tmp_path} holds no dataset.json")


def test_a_training_without_its_configuration_is_one_clear_line(tmp_path: Path) -> None:
    missing = tmp_path / "no.toml"
    done = goshawk("train", "run", "--config", str(missing), "--data", str(tmp_path), "--out", str(tmp_path / "run"))
    assert done.returncode == 2
    assert one_line(done.stderr).startswith(f"goshawk train run: {missing}: ")


@pytest.mark.parametrize(
    "arguments", [["--help"], ["status", "--help"], ["train", "--help"], ["campaign", "--help"], ["dataset", "--help"]]
)
def test_no_command_waits_for_torch_that_does_not_need_it(arguments: list[str]) -> None:
    code = "import sys\nfrom goshawk_ground.cli import app\ntry: app(sys.argv[1:])\n"
    code += "finally: print(*sorted({'torch', 'goshawk_train'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    loaded = done.stdout.splitlines()[-1].split()
    assert "torch" not in loaded
    assert ("goshawk_train" in loaded) == (arguments[0] in ("train", "campaign", "dataset"))


@pytest.mark.parametrize("group", ["train", "dataset", "campaign"])
def test_without_the_trainer_its_help_and_its_commands_say_how_to_install_it(
    group: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("goshawk_ground.commands.trainer.PACKAGE", "goshawk_that_is_not_there")
    helped = CliRunner().invoke(app, [group, "--help"])
    assert helped.exit_code == 0
    assert "make setup-train" in helped.stdout
    done = CliRunner().invoke(app, [group, "any", "--option"])
    assert done.exit_code == 2
    assert one_line(done.stderr) == f"goshawk: no {group} any: the trainer is not installed: make setup-train"


@pytest.mark.parametrize("group", ["train", "dataset", "campaign"])
def test_help_is_given_where_there_is_no_torch(group: str) -> None:
    code = "import sys; sys.modules['torch'] = None; from goshawk_ground.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code, group, "--help"], capture_output=True, text=True, check=True)
    assert "Commands" in done.stdout and "setup-train" not in done.stdout


def test_a_library_that_the_trainer_lacks_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("goshawk_train")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    done = CliRunner().invoke(app, ["train", "validate", "--run", "run", "--data", "data"])
    assert done.exit_code == 2
    assert one_line(done.stderr) == "goshawk train validate: torch is not installed: make setup-train"


def test_a_command_starts_again_once_with_the_settings_that_it_wants(tmp_path: Path) -> None:
    script = tmp_path / "again.py"
    script.write_text(
        "import os, sys\n"
        "from goshawk_ground.commands.trainer import restart_with\n"
        "print('here', flush=True)\n"
        "restart_with({'GOSHAWK_A': '1', 'GOSHAWK_B': '2'})\n"
        "print(os.environ['GOSHAWK_A'], os.environ['GOSHAWK_B'], *sys.argv[1:])\n"
    )
    command = [sys.executable, str(script), "x"]
    environment = {**os.environ, "GOSHAWK_B": "own"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["here", "here", "1", "own", "x"]
