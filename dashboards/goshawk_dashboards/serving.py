"""The web server that a dashboard draws on: dark, quiet, and on the port that was asked for or not at all."""

from __future__ import annotations

import contextlib
import io
import socket

import viser

from goshawk_dashboards import theme


class PortBusyError(OSError):
    """The dashboard's port is taken."""


def open_server(host: str, port: int, label: str) -> viser.ViserServer:
    """A server that listens. Raises PortBusyError if ``port`` cannot be bound."""
    _check_free(host, port)
    with contextlib.redirect_stdout(io.StringIO()):  # its banner; the address is the caller's to print
        server = viser.ViserServer(host=host, port=port, label=label, verbose=False)
    server.gui.configure_theme(
        dark_mode=True, show_logo=False, show_share_button=False, brand_color=theme.VEHICLE, control_width="large"
    )
    return server


def close_server(server: viser.ViserServer) -> None:
    """Stops serving, without its words."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def url_of(server: viser.ViserServer) -> str:
    """Where to point a browser on this machine."""
    host = server.get_host()
    return f"http://{'localhost' if host in ('0.0.0.0', '::') else host}:{server.get_port()}"


def _check_free(host: str, port: int) -> None:
    """viser would quietly take the next port; an operator must get the address they asked for, or be told."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise PortBusyError(f"cannot serve the dashboard on {host}:{port}: {error.strerror}") from error
