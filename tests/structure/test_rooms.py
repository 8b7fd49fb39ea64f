"""The Python packages' rooms: no circle between files or folders, and no room too full; nor one of a Rust crate's.

Read from the source: an import that runs late, or that is for types only, counts as well.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = (
    "air/sensors/goshawk_sensors",
    "dashboards/goshawk_dashboards",
    "ground/station/goshawk",
    "ground/station/goshawk_ground",
    "ground/train/goshawk_train",
    "proto/python/goshawk_proto",
)
CRATES = sorted(path.parent for half in ("air", "ground", "proto") for path in (ROOT / half).rglob("src/lib.rs"))
MOST_FILES = 13
"""Source files right in one folder: about as many as a reader keeps apart."""

Graph = Mapping[str, frozenset[str]]
"""A node → what it imports."""


def modules(package: Path) -> dict[str, Path]:
    """Each file of a package by its dotted name; a folder's ``__init__.py`` has the folder's."""
    found: dict[str, Path] = {}
    for path in sorted(package.rglob("*.py")):
        parts = path.relative_to(package.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def between_files(package: Path) -> dict[str, frozenset[str]]:
    """What each file of a package imports of the same package.

    Importing ``a.b.c`` runs ``a/b/__init__.py`` too, but that is no edge: a room's door may import from its room.
    """
    known = modules(package)
    return {name: frozenset(_imports(name, path, known)) - {name} for name, path in known.items()}


def between_folders(package: Path) -> dict[str, frozenset[str]]:
    """The same for folders: one imports another if a file right in it imports a file right in the other."""
    known = modules(package)
    folders = {name: path.parent.relative_to(package.parent).as_posix() for name, path in known.items()}
    graph: dict[str, set[str]] = {folder: set() for folder in folders.values()}
    for name, imported in between_files(package).items():
        graph[folders[name]] |= {folders[other] for other in imported}
    return {folder: frozenset(others - {folder}) for folder, others in graph.items()}


def circle(graph: Graph) -> list[str] | None:
    """A way from a node back to itself, each importing the next; None: there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        # The sorter's own order is from what is imported to who imports it.
        return list(reversed(error.args[1]))
    return None


def _imports(name: str, path: Path, known: Mapping[str, Path]) -> Iterator[str]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            # Each dot beyond the first is one folder up.
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *filter(None, [node.module])])
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                if whole in known:
                    yield whole
                elif base in known:
                    yield base


def too_full(package: Path) -> list[str]:
    """The folders with more than ``MOST_FILES`` files, each with its count."""
    folders = {path.parent for path in modules(package).values()}
    counts = {folder: len(list(folder.glob("*.py"))) for folder in folders}
    return [f"{folder.name}: {count}" for folder, count in sorted(counts.items()) if count > MOST_FILES]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_file_imports_itself_by_way_of_others(package: str) -> None:
    graph = between_files(ROOT / package)
    assert any(graph.values()) or len(graph) <= 2, f"no imports were found in {package}"
    assert (found := circle(graph)) is None, " → ".join(found)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_folder_imports_itself_by_way_of_others(package: str) -> None:
    assert (found := circle(between_folders(ROOT / package))) is None, " → ".join(found)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_room_is_too_full(package: str) -> None:
    assert too_full(ROOT / package) == []


@pytest.mark.parametrize("source", CRATES, ids=lambda source: source.relative_to(ROOT).as_posix())
def test_no_room_of_a_crate_is_too_full(source: Path) -> None:
    folders = [source, *(path for path in sorted(source.rglob("*")) if path.is_dir())]
    counts = {folder: sum(not file.stem.endswith("tests") for file in folder.glob("*.rs")) for folder in folders}
    assert [f"{folder.name}: {count}" for folder, count in counts.items() if count > MOST_FILES] == []


def made_up(folder: Path, files: dict[str, str]) -> Path:
    """A package on disk of these files."""
    package = folder / "house"
    for name, text in {"__init__.py": "", **files}.items():
        path = package / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return package


@pytest.mark.parametrize(
    "back",
    [
        "from house import first",
        "from house.first import X",
        "import house.first",
        "from . import first",
        "from .first import X",
        "def later():\n    from house.first import X",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from house.first import X",
    ],
)
def test_a_circle_of_files_is_found_however_it_is_written(tmp_path: Path, back: str) -> None:
    package = made_up(
        tmp_path, {"first.py": "from house.second import Y\nX = 1", "second.py": "import house.third", "third.py": back}
    )
    found = circle(between_files(package))
    assert found is not None
    assert found[0] == found[-1]
    graph = between_files(package)
    assert all(after in graph[before] for before, after in pairwise(found))
    assert set(found) == {"house.first", "house.second", "house.third"}


def test_a_circle_of_folders_is_found_where_the_files_have_none(tmp_path: Path) -> None:
    package = made_up(
        tmp_path,
        {
            "attic/roof.py": "from ..cellar.wall import W",
            "attic/beam.py": "B = 1",
            "cellar/wall.py": "W = 1",
            "cellar/floor.py": "from house.attic.beam import B",
        },
    )
    assert circle(between_files(package)) is None
    assert set(circle(between_folders(package)) or []) == {"house/attic", "house/cellar"}


def test_a_door_that_imports_from_its_room_is_no_circle(tmp_path: Path) -> None:
    package = made_up(
        tmp_path,
        {
            "attic/__init__.py": "from house.attic.roof import R",
            "attic/roof.py": "from house.attic.beam import B\nR = 1",
            "attic/beam.py": "B = 1",
        },
    )
    assert circle(between_files(package)) is None


def test_a_room_too_full_is_named(tmp_path: Path) -> None:
    package = made_up(tmp_path, {f"attic/box_{k}.py": "" for k in range(MOST_FILES)})
    assert too_full(package) == []
    (package / "attic/one_more.py").write_text("", encoding="utf-8")
    assert too_full(package) == ["attic: 14"]
