"""Key expressions and their QoS, read from `keys.toml`, the table that Rust and Python share."""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from types import MappingProxyType
from typing import Any, Literal

import zenoh
from google.protobuf.message import Message

from . import goshawk_pb2

PREFIX = "goshawk"
ANY_VEHICLE = "*"
"""In place of a vehicle's name: every vehicle. For subscribers and liveliness only."""

Role = Literal["vehicle", "sensor", "operator", "observer"]
"""Who takes part: an operator or observer is known by its certificate, a sensor by being on the vehicle's host."""

_PROTOBUF = "application/protobuf;"
"""Before a message's name, in a payload's encoding."""
_PACKAGE = goshawk_pb2.DESCRIPTOR.package

_VEHICLE_NAME = re.compile(r"[a-z0-9_-]+")

_PRIORITIES: Mapping[str, zenoh.Priority] = {
    "real_time": zenoh.Priority.REAL_TIME,
    "interactive_high": zenoh.Priority.INTERACTIVE_HIGH,
    "interactive_low": zenoh.Priority.INTERACTIVE_LOW,
    "data_high": zenoh.Priority.DATA_HIGH,
    "data": zenoh.Priority.DATA,
    "data_low": zenoh.Priority.DATA_LOW,
    "background": zenoh.Priority.BACKGROUND,
}
_CONGESTIONS: Mapping[str, zenoh.CongestionControl] = {
    "drop": zenoh.CongestionControl.DROP,
    "block": zenoh.CongestionControl.BLOCK,
}


@dataclass(frozen=True, kw_only=True)
class KeyRow:
    """One row of the table; a key expression is `goshawk/{vehicle}/{suffix}`."""

    name: str
    suffix: str
    kind: Literal["pub", "query", "liveliness"]
    sent_by: frozenset[Role]
    """Who publishes, asks or shows itself alive: the table's `from`."""
    taken_by: frozenset[Role]
    """Who subscribes, answers or watches: the table's `to`."""
    message: type[Message] | None
    """Payload (of the request, for a query); None: empty."""
    reply: type[Message] | None
    """A query's reply; None for other kinds."""
    priority: zenoh.Priority
    congestion: zenoh.CongestionControl
    express: bool

    @property
    def encoding(self) -> zenoh.Encoding:
        """What a payload is called on the wire: for a while after a reconnection, Zenoh may hand on messages under
        another key."""
        return zenoh.Encoding(f"{_PROTOBUF}{self._name}") if self._name else zenoh.Encoding.ZENOH_BYTES

    def names_another(self, encoding: zenoh.Encoding | None) -> bool:
        """Whether a payload says that it is another message than this key's. One that does not say may be it."""
        kind, _, name = str(encoding).partition(";")
        return f"{kind};" == _PROTOBUF and name not in ("", self._name, f"{_PACKAGE}.{self._name}")

    @property
    def _name(self) -> str:
        return "" if self.message is None else self.message.DESCRIPTOR.name


def _message(name: str) -> type[Message] | None:
    if not name:
        return None
    message = getattr(goshawk_pb2, name, None)
    if not (isinstance(message, type) and issubclass(message, Message)):
        raise ValueError(f"keys.toml names {name!r}, which goshawk.proto does not define")
    return message


def _row(row: dict[str, Any]) -> KeyRow:
    return KeyRow(
        name=row["name"],
        suffix=row["suffix"],
        kind=row["kind"],
        sent_by=frozenset(row["from"]),
        taken_by=frozenset(row["to"]),
        message=_message(row["message"]),
        reply=_message(row.get("reply", "")),
        priority=_PRIORITIES[row["priority"]],
        congestion=_CONGESTIONS[row["congestion"]],
        express=row["express"],
    )


_TABLE = tomllib.loads(files("goshawk_proto").joinpath("keys.toml").read_text(encoding="utf-8"))

PROTOCOL: int = _TABLE["protocol"]
"""What a vehicle's heartbeat must say, or this ground may only stop it."""

KEYS: Mapping[str, KeyRow] = MappingProxyType({row["name"]: _row(row) for row in _TABLE["key"]})
"""Name → row, in the table's order. Read-only."""


def key_expression(name: str, vehicle: str) -> str:
    """`goshawk/{vehicle}/{suffix}` of the row `name`.

    `vehicle` is one or more of a-z, 0-9, '_', '-', or ANY_VEHICLE. Raises KeyError for an unknown row, ValueError for a
    bad vehicle name.
    """
    if vehicle != ANY_VEHICLE and not _VEHICLE_NAME.fullmatch(vehicle):
        raise ValueError(f"vehicle name {vehicle!r}: use one or more of a-z, 0-9, '_' and '-'")
    return f"{PREFIX}/{vehicle}/{KEYS[name].suffix}"


def parse_key(expression: str) -> tuple[KeyRow, str] | None:
    """The row and the vehicle that an expression without wildcards names; None if it is not in the table."""
    prefix, _, rest = expression.partition("/")
    vehicle, _, suffix = rest.partition("/")
    if prefix != PREFIX or not _VEHICLE_NAME.fullmatch(vehicle):
        return None
    return next(((row, vehicle) for row in KEYS.values() if row.suffix == suffix), None)
