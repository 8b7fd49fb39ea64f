"""Opens a dashboard as its page in a browser does, without a browser: for benchmarks and tests."""

from __future__ import annotations

import http.client
from typing import Any
from urllib.parse import urlsplit

import viser
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin, Subprotocol

CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (3.0, 3.0, 3.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 900,
    "image_width": 1440,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""What a browser says first; viser counts it as connected from then on."""


def viser_protocol() -> Subprotocol:
    """What viser's page offers; viser turns away every other version's."""
    return Subprotocol(f"viser-v{viser.__version__}")


def cookie_for(link: str) -> str:
    """The session that a link begins. Raises PermissionError if it is not valid."""
    parts = urlsplit(link)
    asked = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=20)
    try:
        asked.request("GET", f"{parts.path}?{parts.query}")
        given = asked.getresponse().headers.get("Set-Cookie")
    finally:
        asked.close()
    if given is None:
        raise PermissionError("this link is not valid")
    return given.partition(";")[0]


def open_page(link: str) -> ClientConnection:
    """The WebSocket of a page that a link of this machine opened."""
    place = urlsplit(link).netloc
    return connect(
        f"ws://{place}/",
        origin=Origin(f"http://{place}"),
        subprotocols=[viser_protocol()],
        additional_headers={"Cookie": cookie_for(link)},
        max_size=None,
        compression=None,
    )
