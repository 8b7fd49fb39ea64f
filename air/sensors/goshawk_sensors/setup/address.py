"""Where the vehicle is dialled: what can never be answered is refused, and not dialled for ever."""

from __future__ import annotations

import os
import re
import socket

from goshawk_sensors.setup.errors import CameraError

SOCKET_BYTES = 107
"""The longest name of a unix socket: sockaddr_un holds 108 bytes, the last of them 0."""
_HOST_AND_PORT = re.compile(r"(\[[^]]+\]|[^:\[\]\s]+):([0-9]{1,5})")


def checked(endpoint: str) -> str:
    """The endpoint as it is. One that nobody answers yet is good: the vehicle may start later.

    Raises CameraError for TLS, for a unix socket's name that cannot be one, and for a host or port that are none.
    """
    protocol, _, rest = endpoint.partition("/")
    address = re.split("[?#]", rest, maxsplit=1)[0]  # what follows is Zenoh's own settings
    if "\0" in endpoint:
        raise CameraError(f"the endpoint {endpoint!r} has a NUL character: take it out")
    if protocol == "tls":
        raise CameraError(
            f"'{endpoint}' asks for an identity, and a camera has none: leave out --connect, and let the vehicle "
            'listen to "unixsock-stream//run/goshawk/sensors.sock"'
        )
    if protocol == "unixsock-stream" and len(os.fsencode(address)) > SOCKET_BYTES:
        raise CameraError(f"'{endpoint}' is too long: a socket's name has at most {SOCKET_BYTES} bytes")
    if protocol == "tcp":
        _check_host_and_port(endpoint, address)
    return endpoint


def _check_host_and_port(endpoint: str, address: str) -> None:
    parts = _HOST_AND_PORT.fullmatch(address)
    if parts is None or not 0 < int(parts[2]) < 65_536:
        raise CameraError(f"'{endpoint}' is not an endpoint such as tcp/127.0.0.1:7447, with a port from 1 to 65535")
    try:
        socket.getaddrinfo(parts[1].strip("[]"), int(parts[2]), type=socket.SOCK_STREAM)
    except UnicodeError as error:
        raise CameraError(f"'{endpoint}' names no host: dial tcp/127.0.0.1:{parts[2]}") from error
    except socket.gaierror as error:
        if error.errno == socket.EAI_AGAIN:
            return  # the network may come: it is dialled until then
        raise CameraError(
            f"'{endpoint}' names a host that is not known ({error.strerror}): dial tcp/127.0.0.1:{parts[2]}"
        ) from error
