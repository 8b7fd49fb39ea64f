"""What is installed elsewhere: the wheel, its ranges, the one version, and what the public CI calls."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
import zipfile
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PINS = dict(re.findall(r"^([\w.-]+)==([\w.]+)", (ROOT / "tests/requirements.txt").read_text(), re.MULTILINE))
EXTRAS: dict[str, list[str]] = PROJECT["optional-dependencies"]
RANGES = [Requirement(text) for some in (PROJECT["dependencies"], *EXTRAS.values()) for text in some]
BESIDE: dict[str, dict[str, Any]] = {
    folder: tomllib.loads((ROOT / folder / "pyproject.toml").read_text())["project"]
    for folder in ("air/sensors", "ground/train")
}
"""The packages that are installed beside `goshawk`."""
WORKFLOWS = sorted((ROOT / ".github/workflows").glob("*.yml"))


BUILD = (ROOT / "air/deb/build.sh").read_text()
CRATES = [file.parent for file in ROOT.glob("[agp]*/**/Cargo.toml")]
"""Those of the workspace that are not tests."""


def _extras(folder: str) -> dict[str, list[str]]:
    return BESIDE[folder].get("optional-dependencies", {})


def _tracked(*folders: str) -> list[str]:
    return subprocess.check_output(["git", "ls-files", *folders], cwd=ROOT, text=True).splitlines()


def test_all_packages_have_one_version() -> None:
    crates = tomllib.loads((ROOT / "Cargo.toml").read_text())["workspace"]["package"]
    assert {crates["version"], *(each["version"] for each in BESIDE.values())} == {PROJECT["version"]}


@pytest.mark.parametrize("folder", BESIDE)
def test_no_package_asks_the_index_for_goshawk(folder: str) -> None:
    """There it is another project's: it must come out of the same checkout."""
    asked = [*BESIDE[folder]["dependencies"], *(each for some in _extras(folder).values() for each in some)]
    assert len(asked) > 5
    assert not {Requirement(each).name for each in asked} & {PROJECT["name"], *(p["name"] for p in BESIDE.values())}


def test_the_cameras_package_installs_on_arm_without_librealsense() -> None:
    asked = {each.name: each for each in map(Requirement, BESIDE["air/sensors"]["dependencies"])}
    marker = asked["pyrealsense2"].marker
    assert marker is not None and not marker.evaluate({"platform_machine": "aarch64"})


@pytest.mark.parametrize("wanted", RANGES, ids=str)
def test_a_range_of_the_wheel_holds_what_is_pinned_and_ends_somewhere(wanted: Requirement) -> None:
    assert PINS[wanted.name] in wanted.specifier
    assert any(part.operator == "<" for part in wanted.specifier)


def test_the_wheel_asks_for_what_the_ground_is_pinned_to() -> None:
    files = ("ground/requirements.in", "ground/rerun/requirements.in")
    pinned = {name for file in files for name in re.findall(r"^[\w.-]+", (ROOT / file).read_text(), re.MULTILINE)}
    # ONNX Runtime is the vehicle's: its package brings it.
    brought = {"onnxruntime"}
    assert {wanted.name for wanted in RANGES} == (pinned | {"cryptography", "pillow", "zstandard"}) - brought


def test_the_wheel_holds_every_file_of_its_packages(tmp_path: Path) -> None:
    build = "import setuptools.build_meta as b, sys; b.build_wheel(sys.argv[1])"
    packages = {
        "goshawk_proto": "proto/python", "goshawk_dashboards": "dashboards", "goshawk_ground": "ground/station",
        "goshawk": "ground/station",
    }  # fmt: skip
    listed = subprocess.check_output(
        ["git", "ls-files", *(f"{r}/{p}" for p, r in packages.items())], cwd=ROOT, text=True
    )
    tree = tmp_path / "tree"
    for name in (*listed.split(), "pyproject.toml", "LICENSE"):
        copy = tree / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes((ROOT / name).read_bytes())
    subprocess.run([sys.executable, "-c", build, tmp_path], cwd=tree, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("goshawk-*.whl")
    with zipfile.ZipFile(wheel) as packed:
        held = {name for name in packed.namelist() if ".dist-info/" not in name}
        assert packed.read("goshawk_proto/keys.toml") == (ROOT / "proto/keys.toml").read_bytes()
    wanted = {
        name.removeprefix(f"{room}/")
        for name in listed.split()
        for room in set(packages.values())
        if name.startswith(f"{room}/")
    }
    assert held == wanted


def test_every_program_that_is_built_is_packed() -> None:
    programs = {
        tomllib.loads((crate / "Cargo.toml").read_text())["package"]["name"]
        for crate in CRATES
        if (crate / "src/main.rs").is_file()
    }
    assert len(programs) >= 3
    assert set(re.findall(r"^install_program (\S+)$", BUILD, re.MULTILINE)) == programs
    assert set(re.findall(r"^pack (\S+) ", BUILD, re.MULTILINE)) == programs


def test_a_change_to_whatever_is_packed_runs_the_workflow_that_packs_it() -> None:
    workflow = (ROOT / ".github/workflows/packages.yml").read_text()
    patterns: list[str] = re.findall(r'^      - "?([^"\n]+?)"?$', workflow.partition("jobs:")[0], re.MULTILINE)
    assert len(patterns) > 5
    scripts = BUILD + (ROOT / "tests/install/clean_root.sh").read_text()
    named: list[str] = re.findall(r"(?<![\w/$])(?:air|docs|ground|tests)/[\w./-]+", scripts)
    assert "docs/how-to/ros2.md" in named
    packed = [
        *(name for crate in CRATES for name in _tracked(f"{crate.relative_to(ROOT)}")),
        *_tracked("proto/python", "dashboards", "ground/station"),
        *_tracked(*(f"{name}*" for name in named)),
        *_tracked(".cargo", "Cargo.*", "LICENSE", "Makefile", "pyproject.toml", "rust-toolchain.toml"),
        *_tracked("*/Cargo.toml", ".github/workflows/packages.yml", "ground/bootstrap", "ground/requirements.txt"),
    ]

    def runs(file: str) -> bool:  # as GitHub has it, the last pattern that fits decides
        fits = [each for each in patterns if fnmatchcase(file, each.removeprefix("!").replace("**", "*"))]
        return bool(fits) and not fits[-1].startswith("!")

    assert sorted({file for file in packed if not runs(file)}) == []
    assert not runs("ground/train/goshawk_train/config.py") and not runs("docs/how-to/field.md")


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=[path.name for path in WORKFLOWS])
def test_the_public_ci_installs_and_then_only_calls_make(workflow: Path) -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    steps = re.findall(r"^ +- run: (.*)$", workflow.read_text(), re.MULTILINE)
    installs = ("apt-get update && apt-get install ", "rustup target add ")
    calls = [step for step in steps if not step.startswith(installs)]
    assert calls
    for call in calls:
        made = re.fullmatch(r"make ([a-z-]+)( [A-Z]+=\S+)?", call)
        assert made and made[1] in targets, f"{workflow.name}: {call}"
