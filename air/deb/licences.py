"""Prints the licences of the crates that a program holds, for the package that it is in.

licences.py goshawk-air aarch64-unknown-linux-gnu
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

TEXTS = ("LICEN[CS]E*", "COPYING*", "NOTICE*", "COPYRIGHT*")


def _cargo(*arguments: str) -> str:
    return subprocess.check_output(["cargo", *arguments, "--locked", "--offline"], text=True)


def main(program: str, target: str) -> None:
    """One entry a crate that is in it on this target: name, version, licence, and its own licence files."""
    # Of this target alone: the build has fetched no other crates.
    metadata = json.loads(_cargo("metadata", "--format-version", "1", "--filter-platform", target))
    known = {(p["name"], p["version"]): p for p in metadata["packages"]}
    tree = ("tree", "-p", program, "--target", target, "-e", "normal", "--prefix", "none", "--no-dedupe", "-f", "{p}")
    lines = _cargo(*tree).splitlines()
    for name, version in sorted({(line.split()[0], line.split()[1].removeprefix("v")) for line in lines if line}):
        package = known[name, version]
        if package["source"] is None:
            continue  # our own
        print(f"{'=' * 100}\n{name} {version}: {package['license'] or package['license_file']}\n")
        folder = Path(package["manifest_path"]).parent
        for text in sorted({path for pattern in TEXTS for path in folder.glob(pattern) if path.is_file()}):
            print(text.read_text(encoding="utf-8", errors="replace"))


if __name__ == "__main__":
    main(*sys.argv[1:])
