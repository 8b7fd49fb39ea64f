"""What crosses between air and ground: messages (`goshawk_pb2`), the table of keys and QoS (`keys`), how one dials."""

from . import goshawk_pb2
from .dial import LinkError, client_config
from .keys import ANY_VEHICLE, KEYS, PROTOCOL, KeyRow, Role, key_expression, parse_key

__all__ = [
    "ANY_VEHICLE", "KEYS", "PROTOCOL", "KeyRow", "LinkError", "Role", "client_config", "goshawk_pb2", "key_expression",
    "parse_key",
]  # fmt: skip
