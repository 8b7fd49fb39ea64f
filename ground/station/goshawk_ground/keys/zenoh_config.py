"""A Zenoh configuration with an identity, for clients and routers that are not ours."""

from __future__ import annotations

import json
from typing import Any

from goshawk_ground.keys.identity import CA, CERT, KEY, Identity
from goshawk_ground.keys.names import Role


def zenoh_config(identity: Identity, endpoint: str) -> str:
    """JSON5: a person dials ``endpoint``, a vehicle listens on it. Files are named by their full paths."""
    folder = identity.folder.resolve()
    listening = identity.who.role is Role.VEHICLE
    side = "listen" if listening else "connect"
    tls: dict[str, Any] = {
        "root_ca_certificate": str(folder / CA),
        f"{side}_certificate": str(folder / CERT),
        f"{side}_private_key": str(folder / KEY),
        "enable_mtls": True,
        "close_link_on_expiration": True,
    }
    if not listening:
        tls["verify_name_on_connect"] = False
    facts = {
        "mode": "peer" if listening else "client",
        side: {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": {"tls": tls}},
    }
    if listening:
        note = (
            "// Whoever has a key of this authority is let in: goshawk-air adds access lists, another listener must.\n"
        )
    else:
        note = "// Names are not verified: a vehicle's address changes. Check that its common name is vehicle.NAME.\n"
    return f"// {identity.who}\n{note}{json.dumps(facts, indent=2)}\n"
