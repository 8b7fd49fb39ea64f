"""The pages of docs/reference say what the programs say."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]


def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate_docs", ROOT / "docs/generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


GENERATOR = generator()


@pytest.mark.parametrize("columns", ["40", "200"])
def test_the_reference_is_current_in_a_terminal_of_any_width(columns: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("CLICOLOR_FORCE", "1")
    made = GENERATOR.generate()
    stale = [name for name, text in made.items() if (GENERATOR.REFERENCE / name).read_text(encoding="utf-8") != text]
    assert not stale, f"run make docs: {stale}"
    pages = {page.name for page in GENERATOR.REFERENCE.glob("*.md")}
    assert pages == {name for name in made if "/" not in name}, "a page that is not made any more"


def test_a_program_that_was_not_built_is_one_line_that_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(GENERATOR, "BIN", tmp_path)
    with pytest.raises(RuntimeError, match="goshawk-air is missing: run make build"):
        GENERATOR.rust_page("goshawk-air", "")


def test_every_key_and_message_of_the_wire_is_on_its_page() -> None:
    page = GENERATOR.wire_page()
    assert "| `cmd/stop` | query | operator | vehicle |" in page
    assert "### PlannerInput" in page
    assert "| `chosen` | 11 | optional uint32 | absent: nothing was eligible" in page
