"""Opens a Zenoh session that dials one endpoint, and no other, for as long as it takes."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import zenoh

from goshawk_ground.keys.chosen import default_identity
from goshawk_ground.keys.names import KeysError
from goshawk_ground.link.tunnel import IdentityError, Tunnel

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


class Way:
    """How to reach a vehicle: straight, or by TLS through a tunnel of our own. Close it when done."""

    def __init__(self, connect: str, vehicle: str, identity: Path | None) -> None:
        """Raises LinkError if ``connect`` is no endpoint, or if it asks for an identity that is not there."""
        protocol, _, address = connect.partition("/")
        self.tunnel: Tunnel | None = None
        if protocol != "tls":
            self.config = client_config(connect)
            return
        host, _, port = address.rpartition(":")
        if not (host and port.isdigit()):
            raise LinkError(f"'{connect}' is not an endpoint such as tls/192.168.1.7:7447")
        try:
            folder = identity or default_identity()
            if folder is None:
                raise LinkError(f"'{connect}' asks who you are: name your identity with --identity (`goshawk keys`)")
            self.tunnel = Tunnel(host=host.strip("[]"), port=int(port), vehicle=vehicle, identity=folder)
        except (IdentityError, KeysError) as error:
            raise LinkError(str(error)) from error
        self.config = client_config(self.tunnel.endpoint)

    @property
    def problem(self) -> str | None:
        """Why the vehicle could not be reached, as far as that is known."""
        return None if self.tunnel is None else self.tunnel.problem

    def open(self, giving_up: threading.Event) -> zenoh.Session | None:
        """Dials until it is answered, or until ``giving_up`` is set: then None."""
        while not giving_up.is_set():
            try:
                return zenoh.open(self.config)
            except zenoh.ZError:
                giving_up.wait(0.1)
        return None

    def close(self) -> None:
        """Ends the tunnel; safe to call twice."""
        if self.tunnel is not None:
            self.tunnel.close()
