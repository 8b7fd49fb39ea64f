"""The design's absences, checked: who may depend on what."""

from __future__ import annotations

import ast
import json
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


def _dependencies() -> dict[str, set[str]]:
    """Direct, non-dev dependencies of each workspace crate."""
    command = ["cargo", "metadata", "--format-version", "1", "--no-deps", "--locked", "--offline"]
    metadata = json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout)
    return {p["name"]: {d["name"] for d in p["dependencies"] if d["kind"] != "dev"} for p in metadata["packages"]}


DEPENDENCIES = _dependencies()


def test_core_depends_on_mathematics_and_what_describes_its_parameters_only() -> None:
    assert DEPENDENCIES["goshawk-core"] == {"nalgebra", "thiserror", "schemars", "serde"}


def test_nothing_depends_on_the_onboard_process() -> None:
    assert [crate for crate, libraries in DEPENDENCIES.items() if "goshawk-air" in libraries] == []


@pytest.mark.parametrize(
    ("library", "allowed"),
    [
        ("mcap", {"goshawk-recorder"}),
        ("ort", {"goshawk-policy"}),
        ("zenoh", {"goshawk-air", "goshawk-bus", "goshawk-ros2", "goshawk-sim"}),
        ("cdr-encoding", {"goshawk-ros2"}),
        ("mavlink", {"goshawk-autopilot", "goshawk-sim"}),
    ],
)
def test_a_library_stays_in_its_room(library: str, allowed: set[str]) -> None:
    assert {crate for crate, libraries in DEPENDENCIES.items() if library in libraries} == allowed


def test_adapters_do_not_import_each_other() -> None:
    adapters = {"goshawk-policy", "goshawk-autopilot", "goshawk-recorder"}
    for crate in adapters:
        assert not DEPENDENCIES[crate] & (adapters - {crate}), crate
        assert not DEPENDENCIES[crate] & {"goshawk-air", "goshawk-sim"}, crate


def test_every_numeric_constant_says_what_it_is() -> None:
    numeric = re.compile(r"\s*(?:pub(?:\(\w+\))? )?const (\w+): [^=]*\b(?:[iuf]\d+|[iu]size|Duration)\b[^=]*=")
    constants = 0
    for path in sorted((ROOT / "air").glob("*/src/**/*.rs")):
        if path.stem.endswith("tests"):
            continue
        above = ""
        for line in path.read_text().split("#[cfg(test)]\nmod ")[0].splitlines():
            if constant := numeric.match(line):
                constants += 1
                assert above.lstrip().startswith("///"), f"{path}: {constant[1]} has no doc comment: unit and reason"
            above = above if line.lstrip().startswith("#[") else line
    assert constants > 300


def _sources(folder: str, *names: str) -> list[Path]:
    """The files below a folder that are named so; there are some."""
    found = sorted(path for name in names for path in (ROOT / folder).rglob(name))
    assert found, f"{folder} is gone: what is looked through now?"
    return found


def test_core_reaches_nothing_outside() -> None:
    outside = re.compile(r"std::(fs|net|thread|env|process|time::(Instant|SystemTime))|println!|tracing::|\brand\b")
    for path in _sources("air/core/src", "*.rs"):
        code = re.sub(r"//.*", "", path.read_text())
        assert not outside.search(code), path


def test_only_what_speaks_with_the_autopilot_or_stands_in_for_it_knows_ned_and_frd() -> None:
    word = re.compile(r"\b\w*_(ned|frd)\b|\b(ned|frd)_\w*\b", re.IGNORECASE)
    rooms = ("air/autopilot", "ground/sim/src/vehicle/px4", "ground/sim/src/vehicle/firmware")
    for folder in ["air", "ground/sim", "proto/src"]:
        for path in _sources(folder, "*.rs"):
            if any(path.is_relative_to(ROOT / room) for room in rooms) or path.name == "px4.rs":
                continue
            assert not word.search(re.sub(r"//.*", "", path.read_text())), path


def test_only_proto_names_a_key() -> None:
    suffix = re.compile(r"[\"'](tel|cmd|alive|sim)/[a-z_]+[\"']|[\"']in/(rgbd|odometry)[\"']")
    for path in (path for folder in ["air", "ground", "dashboards"] for path in _sources(folder, "*.rs", "*.py")):
        if "tests" in path.parts or "test_" in path.name:
            continue
        code = re.sub(r"(//|#).*", "", path.read_text())
        assert not suffix.search(code), path


def _imports(path: Path) -> set[str]:
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize(
    ("folder", "forbidden"),
    [
        ("air/sensors/goshawk_sensors", {"goshawk_ground", "goshawk_dashboards", "goshawk_train", "viser", "torch"}),
        ("dashboards/goshawk_dashboards", {"zenoh", "goshawk_ground", "goshawk_train", "torch"}),
        ("ground/station/goshawk_ground", {"torch", "goshawk_train"}),
        ("ground/train/goshawk_train", {"zenoh", "viser", "goshawk_ground"}),
        (
            "proto/python/goshawk_proto",
            {"goshawk_ground", "goshawk_dashboards", "goshawk_train", "goshawk_sensors", "viser"},
        ),
    ],
)
def test_python_packages_do_not_import_what_they_must_not_know(folder: str, forbidden: set[str]) -> None:
    for path in _sources(folder, "*.py"):
        assert not _imports(path) & forbidden, path


def test_the_trainer_takes_only_canvas_and_log_reader_from_the_dashboards() -> None:
    taken: set[str] = set()
    for path in _sources("ground/train/goshawk_train", "*.py"):
        taken |= set(re.findall(r"(?:from|import) (goshawk_dashboards[\w.]*)", path.read_text()))
    log = {f"goshawk_dashboards.log.{name}" for name in ("flight", "frame", "progress")}
    assert taken == {"goshawk_dashboards.report.canvas", "goshawk_dashboards.state.views", *log}


def test_the_top_level_is_the_design_and_nothing_else() -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    top = {line.split("/")[0] for line in listed.splitlines()}
    files = {
        "Cargo.toml", "Cargo.lock", "Makefile", "README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md",
        "LICENSE", "deny.toml", "clippy.toml", "rustfmt.toml", "rust-toolchain.toml", "pyproject.toml", ".gitignore",
    }  # fmt: skip
    assert top <= files | {
        "air",
        "ground",
        "proto",
        "dashboards",
        "tests",
        "docs",
        "examples",
        ".ci",
        ".cargo",
        ".github",
    }


def test_no_file_is_over_15_megabytes() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, listed.split("\0")):
        path = ROOT / name
        assert not path.exists() or path.stat().st_size <= 15_000_000, name
