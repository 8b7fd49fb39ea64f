"""What the ground half needs: Python, packages, free ports."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import sys
from collections.abc import Iterator

from goshawk_ground.doctor.findings import Finding, bad, note, ok
from goshawk_ground.pages.ports import is_free

OURS = "goshawk"
PORTS = (
    ("dashboard", 8080, False, "`goshawk ground` needs another --port, or end what holds it"),
    ("vehicle's Zenoh", 7447, False, "fine if goshawk-air runs here; the demo takes the next free one"),
    ("MAVLink", 14540, True, "fine if goshawk-air runs here; the demo takes the next free one"),
)


def python() -> Finding:
    """The interpreter."""
    return ok("Python", f"{platform.python_version()}, {sys.executable}")


def packages() -> Finding:
    """Our own package, and each that it names as needed."""
    todo = "install goshawk again, or in a checkout: make setup"
    try:
        needs = importlib.metadata.requires(OURS) or []
    except importlib.metadata.PackageNotFoundError:
        return bad("packages", f"{OURS} itself is not installed", todo)
    names = [OURS, *(re.split(r"[^\w.-]", need)[0] for need in needs if "extra ==" not in need)]
    versions = {name: version(name) for name in names}
    missing = [name for name, found in versions.items() if found is None]
    if missing:
        return bad("packages", f"not installed: {', '.join(missing)}", todo)
    return ok("packages", ", ".join(f"{name} {found}" for name, found in versions.items()))


def optional(name: str, todo: str) -> Finding:
    """A package that only some commands need."""
    found = version(name)
    return note(name, "not installed, optional", todo) if found is None else ok(name, found)


def version(package: str) -> str | None:
    """The installed version; None: it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def ports() -> Iterator[Finding]:
    """Who holds the ports that are used unless others are named."""
    for what, port, udp, todo in PORTS:
        name = f"port {port}/{'udp' if udp else 'tcp'}"
        yield ok(name, f"{what}: free") if is_free(port, udp=udp) else note(name, f"{what}: in use", todo)
