"""Finding a free port near the one that is usual."""

from __future__ import annotations

import socket


def is_free(port: int, *, udp: bool = False, host: str = "127.0.0.1") -> bool:
    """Whether ``port`` can be bound now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM if udp else socket.SOCK_STREAM) as probe:
        if not udp:
            # As servers do: a port in TIME_WAIT is free, one that is listened on is not.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError:
            return False
    return True


def free_port(usual: int, *, udp: bool = False, tries: int = 50) -> int:
    """The usual port, or the next one above it that is free. Raises OSError if none of ``tries`` is."""
    for port in range(usual, min(usual + tries, 65536)):
        if is_free(port, udp=udp):
            return port
    raise OSError(f"no free {'UDP' if udp else 'TCP'} port in {usual} … {usual + tries - 1}")
