"""The encrypted way to a vehicle: Zenoh dials a socket here, and what it says goes on by TLS.

Both sides show a certificate of the same owner, and the vehicle's must bear its name. Zenoh has TLS of its own, but it
reads and writes a link from two threads without a lock, and may end the process when such a link breaks. This way also
says why a vehicle cannot be reached, which Zenoh keeps to itself.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
import tempfile
import threading
from pathlib import Path
from typing import Any, Self

from goshawk_ground.keys.identity import revoked_vehicles
from goshawk_ground.keys.names import KeysError

CHUNK = 16_384
HANDSHAKE_S = 8.0
"""Three round trips, of which a slow link may take two seconds for each."""


class IdentityError(RuntimeError):
    """The identity cannot be used. One line, says what to do."""


class Tunnel:
    """Leads from ``endpoint`` (of this machine) to ``host``:``port``, where only ``vehicle`` is believed."""

    def __init__(self, *, host: str, port: int, vehicle: str, identity: Path) -> None:
        """Listens at once. Raises IdentityError if the folder holds no identity, or one that knows better, or if there
        is no place for a socket."""
        self._host, self._port, self._vehicle = host, port, vehicle
        self._context = _context(identity)
        _check_revoked(identity, vehicle)
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._folder = tempfile.TemporaryDirectory(prefix="goshawk-")  # readable by its owner alone
            self._path = str(Path(self._folder.name) / "link.sock")
            self._socket.bind(self._path)
            self._socket.listen()
        except OSError as error:
            self._socket.close()
            why = error.strerror or error
            raise IdentityError(f"no socket can be made ({why}): let TMPDIR name a short folder with room") from error
        self._stop = asyncio.Event()
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        self._problem: str | None = None
        self._thread = threading.Thread(target=self._run, name="tunnel", daemon=True)
        self._thread.start()

    @property
    def endpoint(self) -> str:
        """Where Zenoh dials."""
        return f"unixsock-stream/{self._path}"

    @property
    def problem(self) -> str | None:
        """Why the last attempt failed; None: it did not, or there was none yet."""
        return self._problem

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends every connection; safe to call twice."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(timeout=3.0)
        self._folder.cleanup()

    def _run(self) -> None:
        with contextlib.suppress(asyncio.CancelledError):
            self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        server = await asyncio.start_unix_server(self._accept, sock=self._socket, limit=CHUNK)
        async with server:
            await self._stop.wait()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = self._loop.create_task(self._carry(reader, writer))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _carry(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            async with asyncio.timeout(HANDSHAKE_S):
                far_reader, far_writer = await asyncio.open_connection(
                    self._host, self._port, ssl=self._context, server_hostname=self._vehicle, limit=CHUNK
                )
            self._check_name(far_writer)
        except (OSError, TimeoutError, IdentityError) as error:
            self._problem = _why(error, self._host, self._port)
            writer.close()
            return
        except asyncio.CancelledError:
            # Zenoh waits for an answer: without this it would for its own ten seconds.
            writer.transport.abort()
            raise
        try:
            await _copy_both(reader, writer, far_reader, far_writer)
            self._problem = None
        except OSError as error:
            # A certificate that the vehicle refuses shows only now: it answers the handshake before it looks.
            self._problem = _why(error, self._host, self._port)
        finally:
            for end in (writer, far_writer):
                end.transport.abort()

    def _check_name(self, writer: asyncio.StreamWriter) -> None:
        subject: Any = writer.get_extra_info("peercert", {}).get("subject", ())
        found = next((value for part in subject for name, value in part if name == "commonName"), "nobody")
        if found != f"vehicle.{self._vehicle}":
            writer.transport.abort()
            raise IdentityError(f"{self._host}:{self._port} is {found}, not vehicle.{self._vehicle}: check --vehicle")


async def _copy_both(
    reader: asyncio.StreamReader,
    writer: asyncio.StreamWriter,
    far_reader: asyncio.StreamReader,
    far_writer: asyncio.StreamWriter,
) -> None:
    """Until either side ends; raises what ended it, if that was an error."""
    ways = [asyncio.ensure_future(_copy(source, sink)) for source, sink in ((reader, far_writer), (far_reader, writer))]
    try:
        done, _ = await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        for way in done:
            way.result()
    finally:
        for way in ways:
            way.cancel()
        await asyncio.gather(*ways, return_exceptions=True)


async def _copy(source: asyncio.StreamReader, sink: asyncio.StreamWriter) -> None:
    while data := await source.read(CHUNK):
        sink.write(data)
        await sink.drain()


def _context(identity: Path) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    context.check_hostname = False  # a vehicle's address changes, its name does not: that is checked instead
    try:
        context.load_verify_locations(identity / "ca.pem")
        context.load_cert_chain(identity / "cert.pem", identity / "key.pem")
    except (OSError, ssl.SSLError) as error:
        why = error.strerror or str(error)
        raise IdentityError(f"{identity} holds no identity ({why}): make one with `goshawk keys`") from error
    return context


def _check_revoked(identity: Path, vehicle: str) -> None:
    """The owner's list of vehicles that are no more."""
    try:
        revoked = revoked_vehicles(identity)
    except KeysError as error:
        raise IdentityError(str(error)) from error
    if vehicle in revoked:
        raise IdentityError(f"vehicle.{vehicle} was revoked: {identity / 'revoked.toml'} lists it")


def _why(error: Exception, host: str, port: int) -> str:
    """One line for an operator."""
    if isinstance(error, IdentityError):
        return str(error)
    if isinstance(error, TimeoutError):
        return f"{host}:{port} does not answer: check address and network"
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"{host}:{port} shows a certificate of another owner ({error.verify_message}): pair with it anew"
    if isinstance(error, ssl.SSLError):
        reason = (error.reason or str(error)).replace("_", " ").lower()
        return f"{host}:{port} refuses your identity ({reason}): see `goshawk keys list`, and pair anew"
    return f"{host}:{port}: {getattr(error, 'strerror', None) or error}"
