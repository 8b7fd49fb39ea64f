"""What people read for the proto's enums. A value that this version does not know is shown by its number."""

from __future__ import annotations

from typing import Any

from goshawk_proto import goshawk_pb2 as pb


def mode(value: int) -> str:
    """ "idle", "track" …"""
    return _word(pb.Mode, value)


def fallback(value: int) -> str:
    """ "none", "hold position" …"""
    return _word(pb.Fallback, value).replace("_", " ")


def rejection(value: int) -> str:
    """ "none", "objectness" …"""
    return _word(pb.Rejection, value)


def severity(value: int) -> str:
    """ "info", "warning" or "error"."""
    return _word(pb.Severity, value)


def _word(enum: Any, value: int) -> str:
    """Without the enum's prefix, lower case: MODE_TRACK -> "track"."""
    if value not in enum.values():
        return str(value)
    return enum.Name(value).removeprefix(enum.DESCRIPTOR.name.upper() + "_").lower()
