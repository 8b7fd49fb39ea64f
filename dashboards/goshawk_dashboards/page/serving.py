"""The viser servers that dashboards draw on: dark, quiet, and to be reached through a gate only."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import viser
import websockets.asyncio.server

from goshawk_dashboards.gate import Addition, Gate, Role
from goshawk_dashboards.page import theme
from goshawk_dashboards.page.pace import pace_html

LONGEST_PATH = 100
"""Characters: what every Unix takes."""
_one_at_a_time = threading.Lock()


def open_server(gate: Gate, role: Role, label: str, addition: Addition | None = None) -> viser.ViserServer:
    """A server for whoever comes through ``gate`` as ``role``; it listens on no port."""
    path = gate.folder / f"{role}.socket"
    if len(str(path)) > LONGEST_PATH:
        raise OSError(f"{gate.folder} is too long a path for a socket file: set TMPDIR to a shorter one")
    with contextlib.redirect_stdout(io.StringIO()), _listening_on(path):  # its banner names a port that there is not
        server = viser.ViserServer(host="127.0.0.1", port=0, label=label, verbose=False)
    if not path.exists():
        close_server(server)
        raise RuntimeError("this viser listens in a way of its own: it would be open to any page of the browser")
    # A browser may ask viser to be shared with the whole internet.
    server.request_share_url = _no_sharing
    server.gui.configure_theme(
        dark_mode=True, show_logo=False, show_share_button=False, brand_color=theme.VEHICLE, control_width="large"
    )
    addition = addition or Addition(foot="")
    gate.lead_to(role, path, replace(addition, foot=pace_html() + addition.foot))
    return server


def close_server(server: viser.ViserServer) -> None:
    """Stops serving, without its words."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


@contextlib.contextmanager
def _listening_on(path: Path) -> Generator[None]:
    """Within, a WebSocket server that is started listens on a socket file: viser takes a host and a port only.

    A port of the loopback would be open to every web page in this machine's browsers, and to its other users.
    """
    with_port = websockets.asyncio.server.serve

    def with_file(handler: Any, _host: str, _port: int, **options: Any) -> Any:
        return with_port(handler, unix=True, path=str(path), **options)

    with _one_at_a_time:
        websockets.asyncio.server.serve = with_file  # pyright: ignore[reportAttributeAccessIssue]
        try:
            yield
        finally:
            websockets.asyncio.server.serve = with_port


def _no_sharing(verbose: bool = True) -> NoReturn:
    raise PermissionError("a dashboard is not shared over viser's own tunnel")
