"""The programs in Rust: are they there, do they run, and do they find the library that runs the network."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from goshawk_ground.doctor.findings import Finding, State, bad, ok, output

AIR, SIM = "goshawk-air", "goshawk-sim"


def programs(bin_dir: Path, missing: State) -> Iterator[Finding]:
    """Both, and the vehicle's library. ``missing``: how bad it is if one is not there."""
    for name in (AIR, SIM):
        yield program(bin_dir / name, missing)
    if (bin_dir / AIR).is_file():
        yield onnxruntime(bin_dir / AIR)


def program(path: Path, missing: State = State.BAD) -> Finding:
    """One program, by running it for its version."""
    todo = f"install the package {path.name}, or in a checkout: make build (needs Rust); or say where with --bin-dir"
    if not path.is_file():
        return Finding(name=path.name, state=missing, text=f"{path} is missing", todo=todo)
    version = output(str(path.resolve()), "--version")
    if version is None:
        return bad(path.name, f"{path} does not run", todo)
    return ok(path.name, f"{version}, {path}")


def onnxruntime(air: Path) -> Finding:
    """Looks where goshawk-air looks: beside it, in the active environment, in a .venv of here, of it, or above."""
    beside = air.resolve().parent
    active = os.environ.get("VIRTUAL_ENV")
    environments = [Path(active)] if active else []
    environments += [above / ".venv" for start in (Path.cwd(), beside) for above in (start, *start.parents)]
    wheels = [w for e in environments for w in sorted(e.glob("lib/python*/site-packages/onnxruntime/capi"))]
    for folder in (beside, *wheels):
        found = sorted(f for kind in ("libonnxruntime.so*", "libonnxruntime.*dylib") for f in folder.glob(kind))
        if found:
            return ok("ONNX Runtime", str(found[-1]))
    todo = "make setup, or the package goshawk-air brings it, or name the library's path in the vehicle file"
    return bad("ONNX Runtime", "no libonnxruntime where goshawk-air looks", todo)
