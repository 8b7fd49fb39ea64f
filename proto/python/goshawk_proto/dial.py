"""How a client of a vehicle sets up its Zenoh session: the ground, a sensor, an example."""

from __future__ import annotations

import json
from typing import Any

import zenoh

LEASE_MS = 2000
HANDSHAKE_MS = 10_000
"""One attempt to dial: two round trips, three more of TLS, and a slow link's may take a second each. A refused one ends
at once; between attempts the wish to give up is looked at."""

_PROTOCOLS = ("tcp", "tls", "unixsock-stream")


class LinkError(RuntimeError):
    """The link cannot even be tried: a bad endpoint or vehicle name. One line, says which."""


def client_config(connect: str) -> zenoh.Config:
    """A client of one endpoint: no discovery; once it was connected it redials by itself after a loss.

    A client, not a peer: the vehicle's session then passes on what a simulator beside it publishes.
    Raises LinkError if ``connect`` is not an endpoint such as tcp/127.0.0.1:7447.
    """
    protocol, _, address = connect.partition("/")
    if protocol not in _PROTOCOLS or not address:
        raise LinkError(f"'{connect}' is not an endpoint such as tls/192.168.1.7:7447")
    settings: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": [connect],
        "connect/timeout_ms": 0,
        "connect/exit_on_failure": True,
        "connect/retry": {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5},
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/shared_memory/enabled": False,  # a session's 17 MB stay in /dev/shm after a kill
        "transport/unicast/open_timeout": HANDSHAKE_MS,
    }
    config = zenoh.Config()
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise LinkError(f"'{connect}' is not a usable endpoint: {' '.join(str(error).split())}") from error
    return config
