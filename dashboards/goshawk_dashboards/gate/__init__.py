"""What stands before the dashboards: who may open them, as what, over which line.

viser asks nobody who he is, and takes a WebSocket from any web page. So it listens on a socket file in a folder that
only this user can enter, and the gate listens where the operator asked: it looks at every request (`headers`), at the
session (`access`), and hands on what is allowed (`relay`). `doors` bounds who stands in the way and for how long.
"""

from goshawk_dashboards.gate.access import Access, Role, SecretError
from goshawk_dashboards.gate.certificate import CertificateError, Tls
from goshawk_dashboards.gate.relay import Addition
from goshawk_dashboards.gate.server import Gate, PortBusyError, UnguardedError

__all__ = [
    "Access",
    "Addition",
    "CertificateError",
    "Gate",
    "PortBusyError",
    "Role",
    "SecretError",
    "Tls",
    "UnguardedError",
]
