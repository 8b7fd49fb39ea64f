"""What the documents name exists: links, headings, files, make targets, commands with their options, tests."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [
        *ROOT.glob("*.md"),
        *(ROOT / "docs").rglob("*.md"),
        *(ROOT / "ground/train").glob("*.md"),
        *(ROOT / "examples").glob("*.md"),
        *(ROOT / "air/models").glob("*.md"),
    ]
)
HISTORY = {"CHANGELOG.md", "NOTEBOOK.md"}
"""Pages that tell of what was: their links must lead somewhere, their files may be gone."""
TODAY = [page for page in PAGES if page.name not in HISTORY]
ROOMS = ("air", "ground", "dashboards", "proto", "tests", "docs", "examples")
FENCE = re.compile(r"^\s*```.*?^\s*```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
SPAN = re.compile(r"`([^`\n]+)`")
MAKE = re.compile(r"(?:^|`)(?:[A-Z]+=\S+ )*make ([a-z-]+)", re.MULTILINE)
CARGO_TEST = re.compile(r"-p (goshawk-\w+) --test (\w+)")
TEST = re.compile(r"`[\w/]*?(\w+\.(?:py|rs))::(\w+)…?`")
PATTERNS = (LINK, MAKE, CARGO_TEST, TEST)


def named(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


@cache
def anchors(page: Path) -> frozenset[str]:
    """The ids that a browser gives a page's headings."""
    heads = re.findall(r"^#+ (.+)$", FENCE.sub("", text(page)), re.MULTILINE)
    return frozenset(re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads)


@cache
def command_pages() -> str:
    return "\n".join(text(page) for page in sorted((ROOT / "docs/reference").glob("goshawk*.md")))


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    for target in LINK.findall(FENCE.sub("", text(page))):
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        place = (page.parent / name).resolve() if name else page
        assert place.exists(), f"{named(page)}: no {target}"
        assert place.is_relative_to(ROOT), f"{named(page)}: {target} leads out of the repository"
        if anchor:
            assert anchor in anchors(place), f"{named(page)}: {target}: no such heading"


def paths(page: Path) -> Iterator[str]:
    """What looks like a file of this repository in a code span or a block."""
    prose = text(page)
    spans = [word for span in SPAN.findall(FENCE.sub("", prose)) for word in span.split()]
    blocks = [word for block in FENCE.findall(prose) for word in block.split()]
    for word in (*spans, *blocks):
        bare = word.strip("()[],;:'\"").partition("::")[0].partition("#")[0].rstrip(".")
        if bare.split("/")[0] in ROOMS and "/" in bare and not re.search(r"[*…{}<>=]|[A-Z]{4,}/", bare):
            yield bare


@pytest.mark.parametrize("page", TODAY, ids=named)
def test_every_file_that_is_named_is_there(page: Path) -> None:
    gone = sorted({path for path in paths(page) if not (ROOT / path).exists()})
    assert not gone, f"{named(page)} names {gone}"


@pytest.mark.parametrize("page", TODAY, ids=named)
def test_every_make_target_that_is_named_is_there(page: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", text(ROOT / "Makefile"), re.MULTILINE))
    asked = set(MAKE.findall(text(page)))
    assert asked <= targets, f"{named(page)}: no {sorted(asked - targets)}"


def commands(page: Path) -> Iterator[str]:
    """Each call of one of our programs in a block or a code span, from its name on."""
    prose = text(page)
    lines = [line for block in FENCE.findall(prose) for line in block.splitlines()]
    for line in (*lines, *SPAN.findall(FENCE.sub("", prose))):
        for part in re.split(r" \| | && |; ", line.partition(" # ")[0]):
            found = re.search(r"(?:^|[\s/])(goshawk(?:-air|-sim)?) (.*)$", part)
            if found and part.lstrip().startswith(("goshawk", ".venv/", "target/", "sudo ")):
                yield f"{found[1]} {found[2]}"


@pytest.mark.parametrize("page", [page for page in TODAY if page.parent.name != "reference"], ids=named)
def test_every_command_and_option_that_is_shown_exists(page: Path) -> None:
    sections = dict(re.findall(r"^## `(.+?)`\n```text\n(.*?)^```", command_pages(), re.MULTILINE | re.DOTALL))
    for command in commands(page):
        words = command.split()
        path = words[0]
        for word in words[1:]:
            if f"{path} {word}" not in sections:
                break
            path = f"{path} {word}"
        rest = words[len(path.split()) :]
        known = "\nCommands:\n" not in sections[path] or not rest or rest[0].startswith("--")
        assert known, f"{named(page)}: no such command: {command}"
        options = re.findall(r"(?<!\S)--[a-z][a-z-]*", command)
        for option in options:
            assert re.search(rf"(?<!\S){option}\b", sections[path]), f"{named(page)}: {path} has no {option}"


@cache
def crates() -> dict[str, Path]:
    """The folder of each Rust package."""
    found = {path: re.search(r'^name = "([\w-]+)"', text(path), re.MULTILINE) for path in ROOT.glob("*/*/Cargo.toml")}
    return {name[1]: path.parent for path, name in found.items() if name}


@pytest.mark.parametrize("page", TODAY, ids=named)
def test_every_cargo_test_that_is_named_is_there(page: Path) -> None:
    for crate, test in CARGO_TEST.findall(text(page)):
        assert (crates()[crate] / f"tests/{test}.rs").exists(), f"{named(page)}: no -p {crate} --test {test}"


@cache
def sources() -> dict[str, str]:
    """What the source files of each name hold."""
    files: dict[str, str] = {}
    for path in (path for folder in ROOMS for path in (ROOT / folder).rglob("*.[pr][ys]")):
        files[path.name] = files.get(path.name, "") + path.read_text(encoding="utf-8")
    return files


@pytest.mark.parametrize("page", PAGES, ids=named)
def test_every_test_that_is_named_is_there(page: Path) -> None:
    files = sources()
    for name, test in TEST.findall(text(page)):
        assert name in files, f"{named(page)}: no {name}"
        assert test in files[name], f"{named(page)}: no {test} in {name}"


def test_each_kind_of_name_is_found_on_some_page() -> None:
    def all_of(find: Callable[[Path], Iterable[object]]) -> int:
        return sum(len(list(find(page))) for page in PAGES)

    kinds = {pattern.pattern: all_of(lambda page, p=pattern: p.findall(text(page))) for pattern in PATTERNS}
    assert min(all_of(paths), all_of(commands), *kinds.values()) > 0, kinds


def test_each_section_of_the_notebook_that_the_code_names_is_there() -> None:
    page = text(ROOT / "ground/train/NOTEBOOK.md")
    there = {
        head.rstrip(".:") for heads in re.findall(r"^#+ (.+)$|\*\*(.+?)\*\*", page, re.MULTILINE) for head in heads
    }
    named = {
        section
        for path in [*(ROOT / "air").rglob("*.rs"), *(ROOT / "ground/sim").rglob("*.rs")]
        for section in re.findall(r'notebook(?:: |, ")([^"]+)"', re.sub(r"\n\s*/// ?", " ", text(path)))
    }
    assert named and not [section for section in named if not any(head.startswith(section) for head in there)]


def test_the_index_reaches_every_page() -> None:
    seen, waiting = set[Path](), [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page in seen or page.suffix != ".md":
            continue
        seen.add(page)
        targets = (target.partition("#")[0] for target in LINK.findall(text(page)) if "://" not in target)
        waiting += [(page.parent / target).resolve() for target in targets if target]
    assert not [named(page) for page in PAGES if page not in seen]


def results(row: str, column: str) -> list[str]:
    """A column of the policy's cells in a row of the flight table, a stale one too: the first word of each."""
    table = (
        text(ROOT / "ground/train/RESULTS.md").partition("<!-- flights: begin -->")[2].partition("<!-- flights: end")[0]
    )
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines() if line.startswith("|")]
    named = [dict(zip(lines[0], cells, strict=True)) for cells in lines[2:]]
    return [
        cells[column].split()[0]
        for cells in named
        if (cells["flight"].partition(" (stale")[0], cells["pilot"]) == (row, "policy")
    ]


@pytest.mark.parametrize(
    ("in_readme", "in_results", "column"),
    [
        ("chasing a target of this speed", "Tracking", "success"),
        ("the same in gusts of 5 m/s", "Tracking in gusts of 5 m/s", "success"),
        ("chasing with a tree every 5 m", "Tracking, fast", "success"),
        ("flying to a goal 120 m ahead", "Navigation, 120 m", "success"),
        ("its cruise speed, m/s", "Navigation, 120 m", "cruise, m/s"),
        ("flying there with a tree every 5 m", "Navigation, 120 m, fast", "success"),
        ("its cruise speed there, m/s", "Navigation, 120 m, fast", "cruise, m/s"),
    ],
)
def test_the_first_pages_figures_are_the_results(in_readme: str, in_results: str, column: str) -> None:
    (line,) = (line for line in text(ROOT / "README.md").splitlines() if line.startswith(f"| {in_readme} |"))
    shown = [cell.strip() for cell in line.split("|")[2:-1]]
    assert [cell for cell in shown if cell] == results(in_results, column) != []


def test_the_first_page_says_what_is_hardest_as_the_results_do() -> None:
    for row, words in (
        ("Tracking a reactive evader", "{} of 24 at 5 m/s. Then"),
        ("Tracking in buildings", "{} of 24 through buildings"),
        ("Tracking along an eight", "{} of 24 along"),
        ("Navigation, 120 m, dense", "{0} of 24 at 6 m/s. At 10 m/s it is often slow: {2} of 24."),
    ):
        assert words.format(*results(row, "success")) in text(ROOT / "README.md")


def test_the_first_page_counts_the_flights_that_hit_something() -> None:
    table = text(ROOT / "ground/train/RESULTS.md").partition("<!-- flights: begin -->")[2]
    rows = [line for line in table.partition("<!-- flights: end")[0].splitlines() if "| policy |" in line]
    flown = sum(int(found) for row in rows for found in re.findall(r"\| \d+ of (\d+) \| \d+% to", row))
    hit = sum(int(found) for row in rows for found in re.findall(r"collision (\d+)", row))
    assert f"{hit} of these {flown} flights hit something." in text(ROOT / "README.md")
