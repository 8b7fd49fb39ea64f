"""Rooms: no folder of a Python package is crowded, and neither its files nor its folders import in a circle."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ["ground/train/goshawk_train"]
CROWDED = 12


def _name(path: Path, package: Path) -> str:
    parts = path.relative_to(package.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imports(package: Path) -> dict[str, set[str]]:
    """By module, the modules of the package that it imports, also within functions."""
    modules = {_name(path, package): path for path in sorted(package.rglob("*.py"))}
    found: dict[str, set[str]] = {}
    for name, path in modules.items():
        wanted: set[str] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                wanted |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: name the module in full"
                inner = {f"{node.module}.{alias.name}" for alias in node.names}
                wanted |= inner & set(modules) or {node.module or ""}
        found[name] = (wanted & set(modules)) - {name}
    return found


def _circle(arrows: dict[str, set[str]]) -> list[str]:
    """Nodes that lead into a circle: what is left once all that lead nowhere are taken away, again and again."""
    left = {node: set(to) for node, to in arrows.items()}
    while ends := {node for node, to in left.items() if not to & set(left)}:
        left = {node: to for node, to in left.items() if node not in ends}
    return sorted(left)


def _between_folders(imports: dict[str, set[str]], packages: set[str]) -> dict[str, set[str]]:
    def folder(module: str) -> str:
        return module if module in packages else module.rpartition(".")[0]

    arrows: dict[str, set[str]] = {package: set() for package in packages}
    for module, others in imports.items():
        arrows[folder(module)] |= {folder(other) for other in others} - {folder(module)}
    root = min(packages, key=len)
    # The root's own files (settings, errors) are for everybody: they are judged as files.
    return {package: to - {root} for package, to in arrows.items() if package != root}


@pytest.mark.parametrize("folder", PACKAGES)
def test_no_python_folder_is_crowded(folder: str) -> None:
    for here in {path.parent for path in (ROOT / folder).rglob("*.py")}:
        files = [path for path in here.glob("*.py") if path.name != "__init__.py"]
        assert len(files) <= CROWDED, here


@pytest.mark.parametrize("folder", PACKAGES)
def test_no_python_file_imports_in_a_circle(folder: str) -> None:
    imports = _imports(ROOT / folder)
    assert len(imports) > 10
    assert _circle(imports) == []


@pytest.mark.parametrize("folder", PACKAGES)
def test_no_python_folders_import_in_a_circle(folder: str) -> None:
    package = ROOT / folder
    packages = {_name(path, package) for path in package.rglob("__init__.py")}
    assert _circle(_between_folders(_imports(package), packages)) == []


def test_a_circle_is_found() -> None:
    assert _circle({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == ["a", "b", "c", "d"]
    assert _circle({"a": {"b"}, "b": set(), "d": {"a"}}) == []
