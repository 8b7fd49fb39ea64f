"""No circles between the files and folders of a Rust crate."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = sorted(path.parent for folder in ("air", "ground", "proto") for path in (ROOT / folder).rglob("src/lib.rs"))

Module = tuple[str, ...]


def modules_of(source: Path) -> dict[Module, str]:
    """The code of each module, without comments and tests."""
    modules: dict[Module, str] = {}
    for path in sorted(source.rglob("*.rs")):
        if path.stem == "tests" or path.stem.endswith("_tests") or path.name == "main.rs":
            continue
        parts = path.relative_to(source).with_suffix("").parts
        module = () if parts == ("lib",) else tuple(part for part in parts if part != "mod")
        code = path.read_text().split("#[cfg(test)]\nmod ")[0].split("#[cfg(test)]\npub(crate) mod ")[0]
        modules[module] = re.sub(r"//.*", "", code)
    return modules


def expanded(path: str) -> list[str]:
    """`a::{b, c::{d, e}}` as `a::b`, `a::c::d`, `a::c::e`."""
    head, brace, rest = path.partition("{")
    if not brace:
        return [path.strip()]
    found, depth, begun = list[str](), 0, 0
    inner = rest[: rest.rindex("}")]
    for k, letter in enumerate([*inner, ","]):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if letter == "," and depth == 0:
            if part := inner[begun:k].strip():
                found += [head.strip() + each for each in expanded(part)]
            begun = k + 1
    return found


def absolute(path: str, module: Module) -> Module | None:
    """A path that begins with `crate`, `super` or `self`, from the crate's root; None: it is of another crate."""
    parts = re.sub(r"\s+as\s+\w+", "", path).replace(" ", "").split("::")
    if parts[0] == "crate":
        return tuple(parts[1:])
    if parts[0] not in ("super", "self"):
        return None
    while parts and parts[0] in ("super", "self"):
        module = module[:-1] if parts[0] == "super" else module
        parts = parts[1:]
    return (*module, *parts)


def uses(modules: dict[Module, str]) -> dict[Module, set[Module]]:
    """Which module names which; a name that a module passes on (`pub use`) is its home's."""
    passed_on: dict[Module, Module] = {}
    named: dict[Module, list[Module]] = {}
    for module, code in modules.items():
        named[module] = []
        for public, path in re.findall(r"^\s*(pub(?:\([^)]*\))? )?use ([^;]*);", code, re.MULTILINE):
            for each in expanded(" ".join(path.split())):
                target = absolute(each, module)
                if target is None and (*module, each.split("::")[0]) in modules:
                    target = absolute(f"self::{each}", module)
                if target is None:
                    continue
                named[module].append(target)
                if public:
                    passed_on[(*module, target[-1])] = target
        inline = re.sub(r"^\s*(pub\S* )?use [^;]*;", "", code, flags=re.MULTILINE)
        for path in re.findall(r"(?<![\w:])((?:crate|super)(?:::\w+)+)", inline):
            if (target := absolute(path, module)) is not None:
                named[module].append(target)

    def home(target: Module) -> Module:
        seen: set[Module] = set()
        while target not in seen:
            seen.add(target)
            for k in range(len(target), 0, -1):
                if target[:k] in passed_on and target[:k] not in modules:
                    target = (*passed_on[target[:k]], *target[k:])
                    break
        return next((target[:k] for k in range(len(target), 0, -1) if target[:k] in modules), ())

    return {module: {home(target) for target in targets} for module, targets in named.items()}


def circle(graph: dict[str, set[str]]) -> list[str] | None:
    """One circle of a graph, its beginning again at its end; None: it has none."""
    done: set[str] = set()

    def walk(node: str, way: list[str]) -> list[str] | None:
        if node in way:
            return [*way[way.index(node) :], node]
        if node in done:
            return None
        for following in sorted(graph.get(node, ())):
            if (found := walk(following, [*way, node])) is not None:
                return found
        done.add(node)
        return None

    return next((found for node in sorted(graph) if (found := walk(node, [])) is not None), None)


def circles(modules: dict[Module, str]) -> list[str]:
    """A circle of each folder whose files, or the folders in it, need each other in a circle."""
    graphs: dict[Module, dict[str, set[str]]] = defaultdict(lambda: defaultdict(set))
    for module, targets in uses(modules).items():
        for target in targets:
            level = next((k for k, (a, b) in enumerate(zip(module, target, strict=False)) if a != b), None)
            if level is not None:  # else one is the other's parent: the two are one idea
                graphs[module[:level]][module[level]].add(target[level])
    found = [(folder, circle(graph)) for folder, graph in sorted(graphs.items())]
    return ["::".join(("crate", *folder)) + ": " + " → ".join(way) for folder, way in found if way is not None]


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.relative_to(ROOT).as_posix())
def test_no_circle_between_files_or_folders(source: Path) -> None:
    assert circles(modules_of(source)) == []


def test_a_circle_is_found_however_it_is_written() -> None:
    for there, back in [
        ("use crate::b::B;", "use crate::a::A;"),
        ("use crate::{c, b::{self, B}};", "use super::a::A;"),
        ("fn f(x: crate::b::B) {}", "use crate::A;"),
    ]:
        modules: dict[Module, str] = {(): "pub use a::A;", ("a",): there, ("b",): back, ("c",): ""}
        assert circles(modules) == ["crate: a → b → a"], there
    nested: dict[Module, str] = {(): "", ("a", "x"): "use crate::b::y;", ("b", "y"): "", ("b", "z"): "use crate::a::x;"}
    assert circles(nested | {("a",): "", ("b",): ""}) == ["crate: a → b → a"]
    straight: dict[Module, str] = {(): "pub use b::B;", ("a",): "use crate::B;", ("b",): "use super::c;", ("c",): ""}
    assert circles(straight) == []
