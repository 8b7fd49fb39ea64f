"""What a request's headers tell about the page it comes from. Nothing here knows of sockets or sessions.

A web page of somebody else's can make a browser ask anything of us, with our cookie. It cannot make the browser lie
about three things: the name that we were called by (Host), the page that asks (Origin), and how near that page is to
us (Sec-Fetch-Site).
"""

from __future__ import annotations

import ipaddress
from collections.abc import Collection, Mapping
from urllib.parse import urlsplit

SECURITY = {
    # viser's page is one file with its script, styles and workers inside, and evaluates; it may speak to nobody but us.
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:; "
    "worker-src 'self' blob: data:; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; "
    "font-src 'self' data:; connect-src 'self' data: blob:; frame-ancestors 'none'; form-action 'self'; "
    "base-uri 'none'; object-src 'none'",
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",  # with less, browsers name no origin when our own form is sent
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
    "Server": "Goshawk",
}
"""Of every answer."""


def name_of(host: str) -> str | None:
    """The name or address in a Host header, without its port; none if it is no such header."""
    try:
        parts = urlsplit(f"//{host}")
        _ = parts.port  # raises where it is no number
    except ValueError:
        return None
    if parts.netloc != host or parts.username is not None or not parts.hostname:
        return None
    return parts.hostname.rstrip(".")


def host_is_ours(host: str, own_address: str, names: Collection[str]) -> bool:
    """Whether we were called by our own name: one of ``names``, or the very address that the connection came to.

    A page whose name was made to point here (DNS rebinding) is so found out. The port may be another one: a tunnel's.
    """
    name = name_of(host)
    if name is None:
        return False
    if name in names:
        return True
    try:
        return _plain(name) == _plain(own_address)
    except ValueError:
        return False


def is_own_page(headers: Mapping[str, str], scheme: str, *, origin_needed: bool) -> bool:
    """Whether our own page asks. ``origin_needed``: browsers always name it then (WebSockets and forms)."""
    near = headers.get("Sec-Fetch-Site", "same-origin")
    if near != "same-origin" and not (near == "none" and not origin_needed):
        return False
    origin = headers.get("Origin")
    if origin is None:
        return not origin_needed
    return origin == f"{scheme}://{headers.get('Host', '')}"


def address_key(address: str) -> str:
    """Who counts as one visitor: an IPv4 address, or the network that one house has in IPv6."""
    found = _plain(address)
    return str(found) if found.version == 4 else str(ipaddress.ip_network((found, 64), strict=False))


def _plain(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """Raises ValueError for what is no address."""
    found = ipaddress.ip_address(address.partition("%")[0])
    return (found.ipv4_mapped or found) if found.version == 6 else found
