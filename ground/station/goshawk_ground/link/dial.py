"""Opens a Zenoh session that dials one endpoint, and no other, for as long as it takes."""

from __future__ import annotations

import threading
from pathlib import Path

import zenoh
from goshawk_proto import ANY_VEHICLE, LinkError, client_config

from goshawk_ground.keys.chosen import default_identity
from goshawk_ground.keys.names import LONGEST_NAME, KeysError
from goshawk_ground.link.tunnel import IdentityError, Tunnel


class Way:
    """How to reach a vehicle: straight, or by TLS through a tunnel of our own. Close it when done."""

    def __init__(self, connect: str, vehicle: str, identity: Path | None) -> None:
        """Raises LinkError if ``connect`` is no endpoint, if ``vehicle`` cannot be there, or if it asks for an
        identity that is not there."""
        if vehicle == ANY_VEHICLE:
            raise LinkError(f"vehicle name '{vehicle}': name one vehicle")
        protocol, _, address = connect.partition("/")
        self.tunnel: Tunnel | None = None
        if protocol != "tls":
            self.config = client_config(connect)
            return
        host, _, port = address.rpartition(":")
        if not (_is_host(host) and port.isascii() and port.isdigit() and 0 < int(port) < 65_536):
            raise LinkError(f"'{connect}' is not an endpoint such as tls/192.168.1.7:7447")
        if len(vehicle) > LONGEST_NAME:
            raise LinkError(f"vehicle name '{vehicle}': one with keys has at most {LONGEST_NAME} characters")
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


def _is_host(text: str) -> bool:
    """A name that may be looked up, or an address."""
    try:
        return bool(text.strip("[]").encode("idna"))
    except UnicodeError:
        return False
