"""Generates the Python messages from the .proto: `python proto/generate.py`. Its output is committed."""

import argparse
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import cast

from grpc_tools import protoc

PROTO_DIR = Path(__file__).resolve().parent
protoc_main = cast("Callable[[list[str]], int]", protoc.main)
SOURCE = "goshawk/v1/goshawk.proto"
PACKAGE_DIR = PROTO_DIR / "python" / "goshawk_proto"


def generate() -> dict[str, bytes]:
    """File name → content of what the package must hold. Raises RuntimeError when the .proto does not compile."""
    with tempfile.TemporaryDirectory() as out:
        status = protoc_main(["protoc", f"-I{PROTO_DIR}", f"--python_out={out}", f"--pyi_out={out}", SOURCE])
        if status != 0:
            raise RuntimeError(f"{SOURCE} does not compile (protoc exit status {status})")
        return {path.name: path.read_bytes() for path in sorted(Path(out, SOURCE).parent.iterdir())}


def main() -> int:
    """Writes the files, or with --check only compares them (exit status 1: they differ)."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="change nothing; fail if a file would change")
    check = parser.parse_args().check
    stale = False
    for name, content in generate().items():
        path = PACKAGE_DIR / name
        if path.is_file() and path.read_bytes() == content:
            continue
        stale = True
        if check:
            print(f"{path} is not what the .proto generates: run python proto/generate.py", file=sys.stderr)
        else:
            path.write_bytes(content)
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
