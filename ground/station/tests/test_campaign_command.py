"""`goshawk campaign report` as an operator meets it, with results that the trainer kept."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from goshawk_ground.cli import app
from typer.testing import CliRunner, Result

ROOT = Path(__file__).resolve().parents[3]
KEPT = ROOT / "ground/train/results/tracking-along-an-eight.json"


def report(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["campaign", "report", *map(str, arguments)])


def one_line(text: str) -> str:
    lines = text.strip().splitlines()
    assert len(lines) == 1, text
    return lines[0]


def test_a_page_lies_beside_its_file_and_the_words_say_what_came_of_it(tmp_path: Path) -> None:
    file = Path(shutil.copy(KEPT, tmp_path))
    done = report(file)
    assert done.exit_code == 0
    first, second = done.stdout.splitlines()
    assert first.startswith(f"{file.name}: ") and first.endswith("flights succeeded")
    assert second == f"{file.with_suffix('.html')}: open it in any browser"
    assert file.with_suffix(".html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_several_files_become_a_page_each_in_a_folder_with_their_figures(tmp_path: Path) -> None:
    files = [Path(shutil.copy(KEPT, tmp_path / f"{name}.json")) for name in "ab"]
    done = report(*files, "--out", tmp_path / "pages", "--figures", tmp_path / "figures", "--json")
    assert done.exit_code == 0
    facts = json.loads(done.stdout)["campaigns"]
    assert [fact["report"] for fact in facts] == [str(tmp_path / "pages" / f"{name}.html") for name in "ab"]
    assert all(fact["flights"] >= fact["successes"] > 0 for fact in facts)
    assert {path.name for path in (tmp_path / "pages").iterdir()} == {"a.html", "b.html"}
    assert (tmp_path / "figures/b/success.png").exists() and (tmp_path / "figures/a/cells.csv").exists()


def test_files_of_one_name_do_not_overwrite_each_other(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    other = Path(shutil.copy(KEPT, tmp_path / "other"))
    done = report(KEPT, other, "--out", tmp_path)
    assert done.exit_code == 2
    assert "two of these files have one name" in one_line(done.stderr)
    assert not list(tmp_path.glob("*.html"))


@pytest.mark.parametrize(
    ("name", "contents", "why"),
    [
        ("no.json", "hello", "is no campaign of goshawk-sim fly --json"),
        ("absent.json", None, "No such file"),
    ],
)
def test_a_file_that_is_no_campaign_is_one_clear_line_and_status_2(
    name: str, contents: str | None, why: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    if contents is not None:
        file.write_text(contents)
    done = report(file)
    assert done.exit_code == 2
    assert str(file) in one_line(done.stderr) and why in done.stderr


def test_a_folder_that_cannot_be_made_is_one_clear_line(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    done = report(KEPT, "--out", tmp_path / "taken")
    assert done.exit_code == 2
    assert one_line(done.stderr).startswith("goshawk: cannot write ")


def test_a_page_is_drawn_without_the_trainer(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "for name in ('torch', 'goshawk_train', 'scipy', 'onnx'): sys.modules[name] = None\n"
        "from goshawk_ground.commands import trainer\n"
        "trainer.trainer_installed = lambda: False\n"
        "from goshawk_ground.cli import main\n"
        "main()\n"
    )
    file = Path(shutil.copy(KEPT, tmp_path))
    done = subprocess.run(
        [sys.executable, "-c", code, "campaign", "report", str(file)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert file.with_suffix(".html").exists()
