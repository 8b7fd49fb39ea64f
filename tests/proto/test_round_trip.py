"""Rust and Python read and write the same bytes; the generated Python is what the .proto says."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from google.protobuf import json_format
from google.protobuf.message import Message
from goshawk_proto import goshawk_pb2

FIXTURES_DIR = Path(__file__).resolve().parent
REPOSITORY = FIXTURES_DIR.parents[1]
TYPES: dict[str, type[Message]] = {
    name: getattr(goshawk_pb2, name) for name in goshawk_pb2.DESCRIPTOR.message_types_by_name
}
TEXT = json.loads((FIXTURES_DIR / "messages.json").read_text(encoding="utf-8"))


def from_text(name: str) -> Message:
    """The message as `messages.json` has it."""
    return json_format.ParseDict(TEXT[name], TYPES[name]())


def unset_fields(message: Message, path: str) -> Iterator[str]:
    """Every field, at any depth, that holds nothing but its default."""
    present = {field.name: value for field, value in message.ListFields()}
    for field in message.DESCRIPTOR.fields:
        name = f"{path}.{field.name}"
        if field.name not in present:
            yield name
        elif field.message_type is not None:
            value = present[field.name]
            for item in [value] if isinstance(value, Message) else value:
                yield from unset_fields(item, name)


@pytest.mark.parametrize("name", sorted(TYPES))
def test_every_field_of_every_message_is_in_the_fixtures(name: str) -> None:
    assert list(unset_fields(from_text(name), name)) == []


@pytest.mark.parametrize("name", sorted(TYPES))
def test_bytes_decode_to_the_text_and_encode_identically(name: str) -> None:
    encoded = (FIXTURES_DIR / f"{name}.bin").read_bytes()
    decoded = TYPES[name].FromString(encoded)
    assert decoded == from_text(name)
    assert decoded.SerializeToString(deterministic=True) == encoded


def test_generated_python_is_unchanged_by_generating_again() -> None:
    script = REPOSITORY / "proto" / "generate.py"
    result = subprocess.run([sys.executable, str(script), "--check"], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_a_stale_generated_file_is_noticed(tmp_path: Path) -> None:
    copy = tmp_path / "proto"
    package = copy / "python" / "goshawk_proto"
    package.mkdir(parents=True)
    (copy / "goshawk").symlink_to(REPOSITORY / "proto" / "goshawk")
    (copy / "generate.py").write_bytes((REPOSITORY / "proto" / "generate.py").read_bytes())
    (package / "goshawk_pb2.py").write_text("stale")
    result = subprocess.run(
        [sys.executable, str(copy / "generate.py"), "--check"], capture_output=True, text=True, check=False
    )
    assert result.returncode == 1
    assert "goshawk_pb2.py" in result.stderr
    assert (package / "goshawk_pb2.py").read_text() == "stale"
