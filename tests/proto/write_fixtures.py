"""Encodes `messages.json` (every message, every field set) to `<Message>.bin`: `python tests/proto/write_fixtures.py`.

Rust decodes the same bytes, compares them with its own literals and encodes them again (`proto/tests/round_trip.rs`).
"""

import json
from pathlib import Path

from google.protobuf import json_format
from goshawk_proto import goshawk_pb2

FIXTURES_DIR = Path(__file__).resolve().parent


def main() -> None:
    """Writes the bytes of every message."""
    for name, fields in json.loads((FIXTURES_DIR / "messages.json").read_text(encoding="utf-8")).items():
        message = json_format.ParseDict(fields, getattr(goshawk_pb2, name)())
        (FIXTURES_DIR / f"{name}.bin").write_bytes(message.SerializeToString(deterministic=True))


if __name__ == "__main__":
    main()
