"""`goshawk campaign report` and `compare` as an operator meets them, with results that the trainer kept."""

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
KEPT = ROOT / "tests/data/campaign-of-an-older-rule.json"


def report(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["campaign", "report", *map(str, arguments)])


def compare(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["campaign", "compare", *map(str, arguments)])


def flown_by_both(folder: Path) -> Path:
    """A campaign in which the classical pilot flew just as the learned one did, but 1 m clearer."""
    parts = json.loads(KEPT.read_text()) | {"rule": "success: it flew"}
    for cell in list(parts["cells"]):
        clear = {name: value + 1.0 for name, value in cell["clearance_m"].items()}
        parts["cells"].append(cell | {"pilot": "classical", "clearance_m": clear})
    out = folder / "both.json"
    out.write_text(json.dumps(parts))
    return out


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


def test_a_comparison_is_a_page_and_words_between_the_marks(tmp_path: Path) -> None:
    page, results, readme = (tmp_path / name for name in ("pages/p.html", "results.md", "readme.md"))
    done = compare(flown_by_both(tmp_path), "--out", page, "--markdown", results, "--readme", readme)
    assert done.exit_code == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert first.startswith("The classical pilot wins. It is better by clearance, the other by nothing.")
    assert second == f"{page}: open it in any browser"
    assert "<h1>The classical pilot wins</h1>" in page.read_text(encoding="utf-8")
    assert "| both | 8 |" in results.read_text(encoding="utf-8")
    words = readme.read_text(encoding="utf-8")
    assert "[The whole comparison](pages/p.html)" in words and "|" not in words


def test_files_of_ones_own_leave_the_projects_documents_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = compare(flown_by_both(tmp_path), "--json", "--figures", "figures")
    assert done.exit_code == 0
    facts = json.loads(done.stdout)
    assert facts["verdict"] == "The classical pilot wins" and facts["learned"]["clearance"]["loses"] == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["both.json", "docs", "figures"]


def test_without_files_the_flight_tables_own_are_compared_and_others_skipped_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    kept = tmp_path / "ground/train/results"
    kept.mkdir(parents=True)
    nothing = compare()
    assert nothing.exit_code == 2 and "nothing to compare" in one_line(nothing.stderr)
    flown_by_both(kept)
    shutil.copy(KEPT, kept)
    (kept / "bad.json").write_text("{}")
    done = compare()
    assert done.exit_code == 0
    assert (
        one_line(done.stderr)
        == "goshawk: skipped bad.json (unreadable), campaign-of-an-older-rule.json (an older rule)"
    )
    assert (tmp_path / "README.md").exists() and (tmp_path / "ground/train/RESULTS.md").exists()


def test_what_cannot_be_compared_or_written_is_one_clear_line_and_status_2(tmp_path: Path) -> None:
    (tmp_path / "bad.json").write_text("hello")
    (tmp_path / "plain.md").write_text("no marks")
    out = ("--out", tmp_path / "p.html")
    for why, done in (
        ("bad.json is no campaign", compare(tmp_path / "bad.json", *out)),
        ("nothing to compare: fly with --pilot policy,classical; skipped campaign-of", compare(KEPT, *out)),
        ("lacks the marks", compare(flown_by_both(tmp_path), *out, "--readme", tmp_path / "plain.md")),
        ("cannot write", compare(flown_by_both(tmp_path), "--out", tmp_path)),
    ):
        assert done.exit_code == 2 and why in one_line(done.stderr)


@pytest.mark.parametrize("command", ["report", "compare"])
def test_a_page_is_drawn_without_the_trainer(command: str, tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "for name in ('torch', 'goshawk_train', 'scipy', 'onnx'): sys.modules[name] = None\n"
        "from goshawk_ground.commands import trainer\n"
        "trainer.trainer_installed = lambda: False\n"
        "from goshawk_ground.cli import main\n"
        "main()\n"
    )
    words = ["campaign", command, str(flown_by_both(tmp_path)), "--out", "out"]
    done = subprocess.run(
        [sys.executable, "-c", code, *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out").exists()
