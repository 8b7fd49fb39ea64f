"""Opens a Zenoh session that dials one endpoint, and no other, for as long as it takes."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any

import zenoh
from goshawk_proto import KEYS, key_expression

LEASE_MS = 2000
HANDSHAKE_MS = 5000
"""One attempt to dial: two round trips, and a slow link's may take a second each. A refused one ends at once; between
attempts the wish to give up is looked at."""

_ENCRYPTED = ("tls", "quic")
_ALL_MESSAGES = [
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "declare_queryable",
    "reply",
    "liveliness_token",
    "declare_liveliness_subscriber",
    "liveliness_query",
]
_PROTOCOLS = ("tcp", "tls", "quic", "udp", "ws", "unixsock-stream", "serial")


class LinkError(RuntimeError):
    """The link cannot even be tried: a bad endpoint or vehicle name. One line, says which."""


def client_config(connect: str, *, vehicle: str = "", identity: Path | None = None) -> zenoh.Config:
    """A client of one endpoint: no discovery; once it was connected it redials by itself after a loss.

    A client, not a peer: the vehicle's session then passes on what a simulator beside it publishes. ``identity``: the
    folder that `goshawk keys` made; over tls and quic both sides show a certificate, and nobody but ``vehicle`` is
    listened to or asked. Raises LinkError if ``connect`` is not an endpoint such as tcp/127.0.0.1:7447, or if the
    identity is missing.
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
    if protocol in _ENCRYPTED:
        if identity is None:
            raise LinkError(f"'{connect}' asks who you are: name your identity with --identity (see `goshawk keys`)")
        settings |= _identified(identity, vehicle)
    config = zenoh.Config()
    try:
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise LinkError(f"'{connect}' is not a usable endpoint: {' '.join(str(error).split())}") from error
    return config


def _identified(folder: Path, vehicle: str) -> dict[str, Any]:
    """Zenoh's settings for a certificate of our own, and for a vehicle that must show its own."""
    for name in ("ca.pem", "cert.pem", "key.pem"):
        try:
            (folder / name).read_bytes()
        except OSError as error:
            raise LinkError(f"{folder / name} cannot be read ({error.strerror}): `goshawk keys` makes it") from error
    return {
        "transport/link/tls": {
            "root_ca_certificate": str(folder / "ca.pem"),
            "connect_certificate": str(folder / "cert.pem"),
            "connect_private_key": str(folder / "key.pem"),
            "enable_mtls": True,
            # A vehicle's address changes, its name does not: the access list below judges that.
            "verify_name_on_connect": False,
            "close_link_on_expiration": True,
        },
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": [
                {
                    "id": "all",
                    "permission": "allow",
                    "flows": ["ingress", "egress"],
                    "messages": _ALL_MESSAGES,
                    "key_exprs": [key_expression(name, vehicle) for name in KEYS],
                }
            ],
            "subjects": [{"id": "vehicle", "cert_common_names": [f"vehicle.{vehicle}"]}],
            "policies": [{"rules": ["all"], "subjects": ["vehicle"]}],
        },
    }


def open_when_reachable(config: zenoh.Config, giving_up: threading.Event) -> zenoh.Session | None:
    """Dials until it is answered, or until ``giving_up`` is set: then None."""
    while not giving_up.is_set():
        try:
            return zenoh.open(config)
        except zenoh.ZError:
            giving_up.wait(0.1)
    return None
