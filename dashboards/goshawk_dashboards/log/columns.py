"""Records of one kind as numpy columns. M rows, one for each record; 3 a vector, 4 a quaternion (w, x, y, z)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError, Message
from numpy.typing import NDArray

from goshawk_dashboards.log import numbers
from goshawk_dashboards.state.views import Array

BLOCK = 4096
"""Records that are read before they become arrays."""
_VECTORS = {"Vec3": "xyz", "Vec3f": "xyz", "Quat": "wxyz"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Columns:
    """Fields of a channel's records, each an array with one row a record; read-only."""

    times_s: Array
    fields: Mapping[str, NDArray[Any]]

    def __getitem__(self, field: str) -> NDArray[Any]:
        return self.fields[field]

    def __len__(self) -> int:
        return len(self.times_s)


def read_columns(
    kind: type[Message],
    fields: Sequence[str],
    times_s: Array,
    payload: Callable[[int], bytes],
    max_hz: float | None,
) -> Columns:
    """Decodes the fields of all records, or of those at least 1 / ``max_hz`` apart; what does not decode is left out.

    Raises KeyError for a field that the message does not have or that is no column.
    """
    getters = [_getter(kind, field) for field in fields]
    rows: list[list[Any]] = [[] for _ in fields]
    blocks: list[list[NDArray[Any]]] = [[empty] for _, empty in getters]
    kept: list[int] = []
    message = kind()
    for index in _spaced(times_s, max_hz):
        try:
            message.ParseFromString(payload(index))
        except DecodeError:
            continue
        kept.append(index)
        for row, (get, _) in zip(rows, getters, strict=True):
            row.append(get(message))
        if len(kept) % BLOCK == 0:
            _pack(rows, blocks)
    _pack(rows, blocks)
    arrays: dict[str, NDArray[Any]] = {}
    for field, (empty, *some) in zip(fields, blocks, strict=True):
        arrays[field] = np.concatenate(some) if some else empty
        arrays[field].setflags(write=False)
    return Columns(times_s=times_s[kept], fields=arrays)


def _pack(rows: list[list[Any]], blocks: list[list[NDArray[Any]]]) -> None:
    """Moves what was read into arrays: Python's own numbers take ten times the memory."""
    for row, some in zip(rows, blocks, strict=True):
        if row:
            some.append(np.array(row))
            row.clear()


def _spaced(times_s: Array, max_hz: float | None) -> Sequence[int]:
    """Which records to take such that they are at least 1 / ``max_hz`` apart; the first is one of them."""
    if max_hz is None or len(times_s) == 0:
        return range(len(times_s))
    slot = np.floor((times_s - times_s[0]) * max_hz + 1e-6)
    return np.flatnonzero(np.diff(slot, prepend=-1.0) > 0).tolist()


def _getter(kind: type[Message], field: str) -> tuple[Callable[[Any], Any], NDArray[Any]]:
    """How to read a field of a message, and what the column of no records is."""
    if "." in field:
        return numbers.getter(field), np.zeros(0)
    descriptor = kind.DESCRIPTOR.fields_by_name[field]
    if descriptor.message_type is not None:
        parts = _VECTORS.get(descriptor.message_type.name)
        if parts is None:
            raise KeyError(f"{field} of {kind.DESCRIPTOR.name} is no number and no vector")
        absent = (np.nan,) * len(parts)
        if parts == "xyz":
            return lambda m: ((v := getattr(m, field)).x, v.y, v.z) if m.HasField(field) else absent, np.zeros((0, 3))
        return lambda m: ((q := getattr(m, field)).w, q.x, q.y, q.z) if m.HasField(field) else absent, np.zeros((0, 4))
    if descriptor.is_repeated:
        raise KeyError(f"{field} of {kind.DESCRIPTOR.name} is a list")
    if descriptor.has_presence:
        return lambda m: float(getattr(m, field)) if m.HasField(field) else np.nan, np.zeros(0)
    whole = isinstance(descriptor.default_value, int) and not isinstance(descriptor.default_value, bool)
    return lambda m: getattr(m, field), np.zeros(0, dtype=np.int64 if whole else np.float64)
