"""What crosses between air and ground: messages (`goshawk_pb2`) and the table of keys and QoS (`keys`)."""

from . import goshawk_pb2
from .keys import ANY_VEHICLE, KEYS, PROTOCOL, KeyRow, Role, key_expression, parse_key

__all__ = ["ANY_VEHICLE", "KEYS", "PROTOCOL", "KeyRow", "Role", "goshawk_pb2", "key_expression", "parse_key"]
