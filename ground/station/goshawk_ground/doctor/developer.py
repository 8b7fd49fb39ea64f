"""What building, testing and training need, in a checkout."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from goshawk_ground.doctor.findings import Finding, State, note, ok, output
from goshawk_ground.doctor.ground import optional
from goshawk_ground.doctor.programs import AIR, SIM, onnxruntime, program

EXTRAS = {
    "goshawk-train": "`goshawk train`, `dataset`, `campaign` (not `report`, `compare`) need it: make setup-train",
    "rerun-sdk": "`goshawk export --format rerun` needs it: make setup-rerun, or the extra goshawk[rerun]",
}
TOOLS = {
    "cargo": "it builds the programs: install Rust (see README)",
    "chromium": "the tests' browser: make setup-test",
    "sshd": "the tests of pairing: make setup-test",
    "ip": "the tests of the network: make setup-test",
}
_SOURCES = ("air", "ground/sim", "proto", "Cargo.lock")


def checkout(bin_dir: Path) -> Iterator[Finding]:
    """Source, programs made of it, tools, and what only some commands need."""
    yield _revision()
    for name in (AIR, SIM):
        yield _current(bin_dir / name)
    yield onnxruntime(bin_dir / AIR)
    for name, todo in TOOLS.items():
        where = shutil.which(name, path=f"{os.environ.get('PATH', os.defpath)}:/usr/sbin")
        yield note(name, "not on the PATH", todo) if where is None else ok(name, where)
    for name, todo in EXTRAS.items():
        yield optional(name, todo)


def _revision() -> Finding:
    revision = output("git", "describe", "--always", "--dirty", "--abbrev=12")
    if revision is not None:
        return ok("source", f"revision {revision}")
    return note("source", "the current directory is no git checkout", "run it from the repository's root")


def _current(path: Path) -> Finding:
    """A program, and whether its source was changed since."""
    found = program(path)
    newer = _newest_source()
    if found.state is not State.OK or newer is None or newer.stat().st_mtime <= path.stat().st_mtime:
        return found
    return note(path.name, f"{found.text}, older than {newer}", "make build, if that change is to fly")


def _newest_source() -> Path | None:
    """The Rust source of the current directory that was changed last; None: there is none."""
    files = [
        file
        for root in map(Path, _SOURCES)
        for file in ([root] if root.is_file() else root.rglob("*.rs"))
        # An editor's lock file is a link that leads nowhere.
        if "tests" not in file.parts and "benches" not in file.parts and file.is_file()
    ]
    return max(files, key=lambda file: file.stat().st_mtime, default=None)
