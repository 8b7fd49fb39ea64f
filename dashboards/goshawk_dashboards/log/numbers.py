"""Every number within a message by a path to it, such as "pos_world.x", "candidates.3.cost" or "rates.camera.hz".

A part of a path is a field's name. Behind a list's name it is a place, or the ``name`` that an item goes by.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

MOST_ITEMS = 256
"""Of a list; what is longer is no signal but a picture."""
_NO_NUMBER = (FieldDescriptor.CPPTYPE_STRING, FieldDescriptor.CPPTYPE_MESSAGE)


def paths(kind: Any, examples: Sequence[Message]) -> Iterator[str]:
    """All paths of a message's kind, a descriptor; lists are as long as the longest of the examples'."""
    for field in kind.fields:
        if field.is_repeated:
            items = [item for example in examples for item in _named(getattr(example, field.name))]
            for part in dict.fromkeys(name for name, _ in items):
                inner = [item for name, item in items if name == part]
                yield from _below(field, f"{field.name}.{part}", inner)
        else:
            inner = [getattr(e, field.name) for e in examples if field.message_type and e.HasField(field.name)]
            yield from _below(field, field.name, inner)


def getter(path: str) -> Callable[[Any], float]:
    """Reads the number at a path; NaN where it is not set."""
    steps = [_step(part) for part in path.split(".")]

    def read(message: Any) -> float:
        value = message
        for step in steps:
            value = step(value)
            if value is None:
                return np.nan
        return float(value)

    return read


def _below(field: FieldDescriptor, path: str, examples: Sequence[Any]) -> Iterator[str]:
    if field.message_type is not None:
        yield from (f"{path}.{rest}" for rest in paths(field.message_type, examples))
    elif field.cpp_type not in _NO_NUMBER:
        yield path


def _named(items: Sequence[Any]) -> list[tuple[str, Any]]:
    """The items of a list, each with its part of a path."""
    return [(getattr(item, "name", "") or str(k), item) for k, item in enumerate(items[:MOST_ITEMS])]


def _step(part: str) -> Callable[[Any], Any]:
    def read(value: Any) -> Any:
        if not isinstance(value, Message):  # a list
            if part.isdecimal():
                return value[int(part)] if int(part) < len(value) else None
            return next((item for item in value if item.name == part), None)
        field = value.DESCRIPTOR.fields_by_name[part]
        if field.has_presence and not value.HasField(part):
            return None
        return getattr(value, part)

    return read
