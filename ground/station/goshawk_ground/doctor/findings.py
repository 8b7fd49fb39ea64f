"""What `goshawk doctor` looks at, each thing as one finding that says what to do. The link is in `link.py`."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import os
import platform
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from goshawk_ground.pages.ports import is_free

BINARIES = ("goshawk-air", "goshawk-sim")
PACKAGES = (
    "goshawk-ground", "goshawk-dashboards", "goshawk-proto", "eclipse-zenoh", "protobuf", "mcap", "numpy", "pillow",
    "viser", "matplotlib", "foxglove-schemas-protobuf", "rosbags", "typer", "rich",
)  # fmt: skip
OPTIONAL = {
    "goshawk-train": "`goshawk train`, `dataset`, `campaign` (not `report`, `compare`) need it: make setup-train",
    "rerun-sdk": "`goshawk export --format rerun` needs it: make setup-rerun",
}
PORTS = (
    ("dashboard", 8080, False, "`goshawk ground` needs another --port, or end what holds it"),
    ("vehicle's Zenoh", 7447, False, "fine if goshawk-air runs here; the demo takes the next free one"),
    ("MAVLink", 14540, True, "fine if goshawk-air runs here; the demo takes the next free one"),
)
_SOURCES = ("air", "ground/sim", "proto", "Cargo.lock")


class State(StrEnum):
    """How a thing is."""

    OK = "ok"
    NOTE = "note"
    """Worth knowing, but nothing is broken."""
    BAD = "bad"


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One line."""

    name: str
    state: State
    text: str
    todo: str = ""
    """What to do; empty only if all is well."""


def ok(name: str, text: str) -> Finding:
    """All is well."""
    return Finding(name=name, state=State.OK, text=text)


def local_findings(bin_dir: Path) -> Iterator[Finding]:
    """Everything but the link, in the order of a machine's set-up."""
    yield ok("Python", f"{platform.python_version()}, {sys.executable}")
    yield from _packages()
    yield _revision()
    for name in BINARIES:
        yield _binary(bin_dir / name)
    yield _onnxruntime(bin_dir)
    for what, port, udp, todo in PORTS:
        name = f"port {port}/{'udp' if udp else 'tcp'}"
        if is_free(port, udp=udp):
            yield ok(name, f"{what}: free")
        else:
            yield Finding(name=name, state=State.NOTE, text=f"{what}: in use", todo=todo)


def _packages() -> Iterator[Finding]:
    versions = {name: _version(name) for name in PACKAGES}
    missing = [name for name, version in versions.items() if version is None]
    if missing:
        yield Finding(name="packages", state=State.BAD, text=f"not installed: {', '.join(missing)}", todo="make setup")
    else:
        yield ok("packages", ", ".join(f"{name} {version}" for name, version in versions.items()))
    for name, todo in OPTIONAL.items():
        version = _version(name)
        if version is None:
            yield Finding(name=name, state=State.NOTE, text="not installed, optional", todo=todo)
        else:
            yield ok(name, version)


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _revision() -> Finding:
    """The source tree's, which is the current directory's."""
    revision = _output("git", "describe", "--always", "--dirty", "--abbrev=12")
    if revision is not None:
        return ok("source", f"revision {revision}")
    return Finding(
        name="source",
        state=State.NOTE,
        text="the current directory is no git checkout",
        todo="run goshawk from the repository's root, where its demo and layouts are",
    )


def _binary(path: Path) -> Finding:
    build = "make build (needs Rust, see README), or say where it is with --bin-dir"
    if not path.is_file():
        return Finding(name=path.name, state=State.BAD, text=f"{path} is missing", todo=build)
    version = _output(str(path.resolve()), "--version")
    if version is None:
        return Finding(name=path.name, state=State.BAD, text=f"{path} does not run", todo=build)
    newer = _newest_source()
    if newer is not None and newer.stat().st_mtime > path.stat().st_mtime:
        text = f"{version}, {path}, older than {newer}"
        return Finding(name=path.name, state=State.NOTE, text=text, todo="make build, if that change is to fly")
    return ok(path.name, f"{version}, {path}")


def _newest_source() -> Path | None:
    """The Rust source of the current directory that was changed last; None: there is none."""
    files = [
        file
        for root in map(Path, _SOURCES)
        for file in ([root] if root.is_file() else root.rglob("*.rs"))
        if "tests" not in file.parts and "benches" not in file.parts
    ]
    return max(files, key=lambda file: file.stat().st_mtime, default=None)


def _output(*command: str) -> str | None:
    """A program's first line of output; None if it cannot be run, fails or hangs."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.strip().partition("\n")[0]


def _onnxruntime(bin_dir: Path) -> Finding:
    """Looks where goshawk-air looks: beside it, in the active environment, in a .venv of here, of it, or above."""
    beside = bin_dir.resolve()
    active = os.environ.get("VIRTUAL_ENV")
    environments = [Path(active)] if active else []
    environments += [above / ".venv" for start in (Path.cwd(), beside) for above in (start, *start.parents)]
    wheels = [w for e in environments for w in sorted(e.glob("lib/python*/site-packages/onnxruntime/capi"))]
    for folder in (beside, *wheels):
        found = sorted(f for kind in ("libonnxruntime.so*", "libonnxruntime.*dylib") for f in folder.glob(kind))
        if found:
            return ok("ONNX Runtime", str(found[-1]))
    spec = importlib.util.find_spec("onnxruntime")
    todo = "make setup, or name the library's path in the vehicle file"
    if spec is not None and spec.origin is not None:
        todo = f"goshawk-air does not look in {Path(spec.origin).parent / 'capi'}: activate that environment, or {todo}"
    return Finding(name="ONNX Runtime", state=State.BAD, text="no libonnxruntime where goshawk-air looks", todo=todo)
