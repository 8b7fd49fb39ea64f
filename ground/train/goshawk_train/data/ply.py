"""Point clouds in PLY files. Shape letter: P points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from goshawk_train.data import DataError

_PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_PLY_ORDER = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


def read_ply(path: Path) -> NDArray[np.float32]:
    """The points [P, 3] of a PLY, whatever else its vertices carry; raises `DataError`."""
    try:
        return _points(path, path.read_bytes())
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from error
    except (IndexError, ValueError) as error:
        raise DataError(f"{path}: not a PLY point cloud ({error})") from error


def _points(path: Path, raw: bytes) -> NDArray[np.float32]:
    end = raw.find(b"end_header")
    body_at = raw.find(b"\n", max(end, 0)) + 1
    lines = [line.split() for line in raw[: max(end, 0)].decode("ascii", errors="replace").splitlines()]
    if end < 0 or not body_at or lines[0] != ["ply"]:
        raise DataError(f"{path}: not a PLY point cloud")
    order = next((words[1] for words in lines if words[0:1] == ["format"]), "")
    elements = [i for i, words in enumerate(lines) if words[:1] == ["element"]]
    if order not in _PLY_ORDER or not elements or lines[elements[0]][1] != "vertex":
        raise DataError(f"{path}: not a PLY whose first element is vertex")
    count = int(lines[elements[0]][2])
    stop = elements[1] if len(elements) > 1 else len(lines)
    properties = [words for words in lines[elements[0] : stop] if words[:1] == ["property"]]
    if any(len(words) != 3 or words[1] not in _PLY_TYPES for words in properties):
        raise DataError(f"{path}: vertex properties that are no plain numbers; write x, y, z only")
    names = [words[2] for words in properties]
    if not {"x", "y", "z"} <= set(names):
        raise DataError(f"{path}: vertices without x, y, z, only {names}")
    body = raw[body_at:]
    if order == "ascii":
        return _ascii_points(path, body, count, names)
    vertex = np.dtype([(words[2], _PLY_ORDER[order] + _PLY_TYPES[words[1]]) for words in properties])
    if len(body) < count * vertex.itemsize:
        raise DataError(f"{path}: truncated: {len(body)} bytes for {count} points")
    table = np.frombuffer(body, dtype=vertex, count=count)
    return np.stack([table[c].astype(np.float32) for c in "xyz"], axis=-1)


def _ascii_points(path: Path, body: bytes, count: int, names: list[str]) -> NDArray[np.float32]:
    rows = body.decode("ascii", errors="replace").splitlines()[:count]
    if len(rows) < count:
        raise DataError(f"{path}: truncated: {len(rows)} lines for {count} points")
    wanted = [names.index(c) for c in "xyz"]
    try:
        table = np.loadtxt(rows, usecols=wanted, ndmin=2) if rows else np.zeros((0, 3))
    except ValueError as error:
        raise DataError(f"{path}: {error}") from error
    return table.astype(np.float32)


def write_ply(path: Path, points_P3: NDArray[np.float32]) -> None:
    """Binary little-endian, float x, y, z."""
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points_P3)}\n"
    header += "property float x\nproperty float y\nproperty float z\nend_header\n"
    path.write_bytes(header.encode() + points_P3.astype("<f4").tobytes())
