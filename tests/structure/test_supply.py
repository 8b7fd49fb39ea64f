"""What comes from outside: crates by licence, source and version, Python packages by their hashes."""

from __future__ import annotations

import json
import re
import subprocess
import tomllib
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).resolve().parents[2]
DENY = tomllib.loads((ROOT / "deny.toml").read_text())
CRATES: list[dict[str, Any]] = tomllib.loads((ROOT / "Cargo.lock").read_text())["package"]
APART = ("air/policy/openvino", "air/sensors", "ground/sim/benches")
"""What has no package for ARM: its pins are not among those of the tests."""
PINS = sorted(path.parent.relative_to(ROOT).as_posix() for path in ROOT.glob("[agt]*/**/requirements.in"))


def _metadata() -> dict[str, Any]:
    """What is built for this computer: `cargo build` has brought it here."""
    command = ["cargo", "metadata", "--format-version", "1", "--locked", "--offline"]
    host = re.search(r"host: (.*)", subprocess.check_output(["rustc", "-vV"], text=True))
    assert host
    return json.loads(subprocess.check_output([*command, "--filter-platform", host[1]], cwd=ROOT))


def _allowed(expression: str, allowed: set[str]) -> bool:
    """SPDX with AND, OR and brackets; a slash is an old OR."""
    words = re.findall(r"\(|\)|/|[\w.+-]+(?: WITH [\w.+-]+)?", expression)
    terms = {"/": "or", "OR": "or", "AND": "and", "(": "(", ")": ")"}
    return bool(eval(" ".join(terms.get(word, str(word in allowed)) for word in words), {}))


@pytest.mark.parametrize(
    ("expression", "allowed"),
    [("MIT", True), ("GPL-3.0", False), ("GPL-3.0 OR MIT", True), ("GPL-3.0 AND MIT", False), ("GPL-3.0/MIT", True),
     ("(MIT OR GPL-3.0) AND GPL-3.0", False), ("MIT WITH X", False)],
)  # fmt: skip
def test_an_expression_is_judged_as_spdx_has_it(expression: str, allowed: bool) -> None:
    assert _allowed(expression, {"MIT"}) == allowed


def test_every_crate_that_is_built_has_an_allowed_licence() -> None:
    allowed = set(DENY["licenses"]["allow"])
    clarified = {entry["crate"]: entry["expression"] for entry in DENY["licenses"]["clarify"]}
    packages = _metadata()["packages"]
    assert len(packages) > 100
    licences = {p["name"]: p["license"] or clarified.get(p["name"], "none") for p in packages}
    assert not {name: licence for name, licence in licences.items() if not _allowed(licence, allowed)}


def test_every_crate_is_ours_or_of_the_one_registry_with_a_checksum() -> None:
    foreign = [crate for crate in CRATES if "source" in crate]
    assert len({crate["source"] for crate in foreign}) == 1
    assert all(crate["source"].startswith("registry+") and crate["checksum"] for crate in foreign)
    changed = set(tomllib.loads((ROOT / "Cargo.toml").read_text()).get("patch", {}).get("crates-io", {}))
    own = {crate["name"] for crate in CRATES if "source" not in crate}
    assert {name for name in own if not name.startswith("goshawk-")} == changed


def test_a_crate_has_one_version_unless_deny_toml_says_why() -> None:
    skipped = {entry["crate"] for entry in DENY["bans"]["skip"]}
    built = _metadata()["packages"]
    times = Counter(p["name"] for p in built)
    several = {f"{p['name']}@{p['version']}" for p in built if times[p["name"]] > 1}
    once = {name.rsplit("@", 1)[0] for name in several - skipped}
    kept = Counter(name.rsplit("@", 1)[0] for name in several - skipped)
    assert not {name for name in once if kept[name] > 1}, "a new duplicate: unify it, or say in deny.toml why not"
    assert skipped <= several, "an exception that is not needed any more"
    assert all(entry["reason"] for entry in DENY["bans"]["skip"])


def _names(text: str) -> set[str]:
    found = re.findall(r"^([A-Za-z0-9._-]+)(?:\[[^]]*\])?", text, re.MULTILINE)
    return {re.sub(r"[-_.]+", "-", name).lower() for name in found if not name.startswith("-")}


@pytest.mark.parametrize("folder", PINS)
def test_every_python_package_is_pinned_by_its_hash(folder: str) -> None:
    text = (ROOT / folder / "requirements.txt").read_text()
    pins = [pin for pin in re.sub(r"\\\n\s*", "", text).splitlines() if pin]
    assert pins
    assert not [
        pin for pin in pins if not re.fullmatch(r"[\w.-]+==\S+ *( ?;[^#]*?)?( *--hash=sha256:[0-9a-f]{64})+", pin)
    ]
    wanted = re.sub(r"(?m)^-r .*$|#.*", "", (ROOT / folder / "requirements.in").read_text())
    assert _names(wanted) <= _names(text), "run make pins"
    assert folder in APART or set(pins) <= set(
        re.sub(r"\\\n\s*", "", (ROOT / "tests/requirements.txt").read_text()).splitlines()
    )


def test_an_arm_computer_asks_for_no_librealsense() -> None:
    """There is no package of it: the set-up would end there."""
    (pin,) = re.findall(r"(?m)^(pyrealsense2==.*?) *\\$", (ROOT / "air/sensors/requirements.txt").read_text())
    marker = Requirement(pin).marker
    assert marker is not None
    assert [marker.evaluate({"platform_machine": machine}) for machine in ("x86_64", "aarch64")] == [True, False]
    assert "pyrealsense2" not in _names((ROOT / "tests/requirements.txt").read_text())
