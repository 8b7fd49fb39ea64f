"""The gate itself: a small HTTP server in a thread of its own, on the address that the operator asked for."""

from __future__ import annotations

import asyncio
import ipaddress
import shutil
import socket
import tempfile
import threading
import time
from http import HTTPStatus
from pathlib import Path
from urllib.parse import parse_qs, quote

import aiohttp
from aiohttp import hdrs, web

from goshawk_dashboards.gate import headers, pages
from goshawk_dashboards.gate.access import SESSION_S, Access, Attempts, Role, Session
from goshawk_dashboards.gate.certificate import Tls
from goshawk_dashboards.gate.doors import Doors, FullError
from goshawk_dashboards.gate.relay import Addition, Upstream

ANSWER_WITHIN_S = 30.0
MOST_FORM_BYTES = 2048
_TRY_LATER = "Too many attempts from this address: wait a second, then try again."
_METHODS = ("GET", "HEAD", "POST")


class PortBusyError(OSError):
    """The dashboard's port is taken."""


class UnguardedError(OSError):
    """Other machines would reach it over a line that anybody reads."""


class Gate:
    """Listens for browsers and lets through who may see a dashboard, each to the dashboard of his role."""

    def __init__(self, *, host: str, port: int, access: Access, tls: Tls | None = None) -> None:
        """Raises PortBusyError if ``port`` cannot be bound, UnguardedError for other machines without ``tls``."""
        self._access, self._tls = access, tls
        self._host, self._listener = host, _listen(host, port, secure=tls is not None)
        self.port: int = self._listener.getsockname()[1]
        self.folder = Path(tempfile.mkdtemp(prefix="goshawk-"))
        """Where the dashboards' socket files are: no other user can enter it."""
        self._sockets: dict[Role, str] = {}
        self._additions: dict[Role, Addition] = {}
        self._upstreams: dict[Role, Upstream] = {}
        own = socket.gethostname().lower()
        self._names = {"localhost", own, f"{own}.local", *(() if tls is None else tls.names)}
        self._attempts = Attempts(time.monotonic)
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="gate", daemon=True)
        self._thread.start()

    @property
    def scheme(self) -> str:
        """Of its addresses."""
        return "http" if self._tls is None else "https"

    @property
    def address(self) -> str:
        """Where a browser on this machine finds it; without a token it asks for one."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]"}.get(self._host, self._host)
        host = f"[{host}]" if ":" in host and not host.startswith("[") else host
        return f"{self.scheme}://{host}:{self.port}/"

    def link(self, role: Role) -> str:
        """What lets a browser in as ``role``."""
        return f"{self.address}?token={quote(self._access.token(role))}"

    def lead_to(self, role: Role, socket_path: Path, addition: Addition | None = None) -> None:
        """Whoever comes as ``role`` gets the viser server that listens there, and what the dashboard adds to it."""
        if addition is not None:
            self._additions[role] = addition
        self._sockets[role] = str(socket_path)

    def close(self) -> None:
        """Ends every page and stops listening."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._end.set)
            self._thread.join(timeout=10.0)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        # No connection is used twice: viser's page is one file and one WebSocket.
        server = web.Server(self._answer, access_log=None, keepalive_timeout=0.0, lingering_time=0.0)
        context = None if self._tls is None else self._tls.context
        self._doors = Doors(self._listener, context, server)
        taking = asyncio.create_task(self._doors.take_in())
        await self._end.wait()
        taking.cancel()
        await asyncio.gather(taking, return_exceptions=True)
        self._listener.close()
        await server.shutdown(timeout=1.0)
        for upstream in self._upstreams.values():
            await upstream.close()

    async def _answer(self, request: web.BaseRequest) -> web.StreamResponse:
        transport = request.transport
        if transport is None:
            raise ConnectionResetError
        peer = transport.get_extra_info("peername")
        form = None
        if request.method == "POST":  # one whose form has not come waits in the door like all others
            form = await _form(request)
        self._doors.asked(peer)
        own_address = transport.get_extra_info("sockname")[0]
        try:
            answer = await self._decide(request, form, headers.address_key(peer[0]), own_address)
        except (aiohttp.ClientError, TimeoutError):
            answer = _page(HTTPStatus.BAD_GATEWAY, pages.refused("The dashboard has ended", "Start it again."))
        except FullError:
            words = "Close some of the pages that show this dashboard, then reload this one."
            answer = _page(HTTPStatus.SERVICE_UNAVAILABLE, pages.refused("Too many pages are open", words))
        if not answer.prepared:
            answer.headers.update(headers.SECURITY)
            answer.force_close()
        return answer

    async def _decide(
        self, request: web.BaseRequest, form: dict[str, list[str]] | None, address: str, own_address: str
    ) -> web.StreamResponse:
        if not headers.host_is_ours(request.headers.get("Host", ""), own_address, self._names):
            words = f"Open it under the address that the ground station printed, or as localhost:{self.port}."
            return _page(HTTPStatus.MISDIRECTED_REQUEST, pages.refused("No dashboard goes by this name", words))
        if request.method not in _METHODS:
            return _page(HTTPStatus.METHOD_NOT_ALLOWED, pages.refused("This cannot be asked", "Open the link instead."))
        socket_wanted = request.headers.get("Upgrade", "").lower() == "websocket"
        if request.method == "POST" or socket_wanted:
            if not headers.is_own_page(request.headers, self.scheme, origin_needed=True):
                words = "Another page asked for it, and only the dashboard's own page may."
                return _page(HTTPStatus.FORBIDDEN, pages.refused("Refused", words))
            if request.method == "POST":
                return self._log_in(request, form, address)
        elif request.query_string:
            return self._by_link(request)
        session = self._session(request)
        if session is None:
            with_password = bool(self._access.passwords)
            return _page(HTTPStatus.UNAUTHORIZED, pages.sign_in(with_password=with_password))
        with self._doors.opened(session.role, address):
            upstream = self._upstream(session.role)
            if socket_wanted:
                own = await upstream.talk(request, session)
                return await upstream.pair(request, session) if own is None else own
            async with asyncio.timeout(ANSWER_WITHIN_S):
                return await upstream.get(request)

    def _by_link(self, request: web.BaseRequest) -> web.StreamResponse:
        """Takes the token off the address. viser would take orders from other words there: they lead to a bare page."""
        tokens = parse_qs(request.query_string).get("token", [])
        if request.path != "/" or not tokens:
            return _onward()
        role = self._access.role_of_token(tokens[0])
        if role is None or role not in self._sockets:
            words = "It is of an earlier start. Open the link that the ground station printed last."
            return _page(HTTPStatus.FORBIDDEN, pages.refused("This link is not valid", words))
        return self._let_in(_page(HTTPStatus.OK, pages.opening()), role)

    def _log_in(self, request: web.BaseRequest, form: dict[str, list[str]] | None, address: str) -> web.StreamResponse:
        if request.path != "/login" or not self._access.passwords:
            return _page(HTTPStatus.NOT_FOUND, pages.refused("Nothing is there", "Open the link instead."))
        if form is None:
            return _page(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, pages.refused("Refused", "A password is shorter."))
        if not self._attempts.may(address):
            return _page(HTTPStatus.TOO_MANY_REQUESTS, pages.sign_in(wrong=_TRY_LATER, with_password=True))
        role = self._access.role_of_password(form.get("password", [""])[0])
        if role is None or role not in self._sockets:
            wrong = "This is not the password."
            return _page(HTTPStatus.FORBIDDEN, pages.sign_in(wrong=wrong, with_password=True))
        return self._let_in(_onward(), role)

    def _let_in(self, answer: web.Response, role: Role) -> web.Response:
        answer.set_cookie(
            self._cookie,
            self._access.new_cookie(role, time.time()),
            max_age=int(SESSION_S),
            path="/",
            httponly=True,
            samesite="Strict",
            secure=self._tls is not None,
        )
        return answer

    @property
    def _cookie(self) -> str:
        """Its name: browsers do not keep the cookies of one machine's ports apart."""
        return f"goshawk-{self.port}"

    def _session(self, request: web.BaseRequest) -> Session | None:
        shown = request.cookies.get(self._cookie)
        session = None if shown is None else self._access.session_of(shown, time.time())
        return session if session is not None and session.role in self._sockets else None

    def _upstream(self, role: Role) -> Upstream:
        if role not in self._upstreams:
            self._upstreams[role] = Upstream(self._sockets[role], self._additions.get(role))
        return self._upstreams[role]


async def _form(request: web.BaseRequest) -> dict[str, list[str]] | None:
    """What a form says; none if it is too long, of no told length, or packed. Raises ConnectionResetError if it ends
    too early, as it does when the door has waited long enough."""
    length = request.content_length
    if length is None or length > MOST_FORM_BYTES or hdrs.CONTENT_ENCODING in request.headers:
        return None
    try:
        return parse_qs((await request.content.readexactly(length)).decode(errors="replace"))
    except (asyncio.IncompleteReadError, aiohttp.ClientError) as error:
        raise ConnectionResetError from error


def _page(status: HTTPStatus, text: str) -> web.Response:
    return web.Response(status=status, text=text, content_type="text/html")


def _onward() -> web.Response:
    return web.Response(status=HTTPStatus.SEE_OTHER, headers={"Location": "/"})


def _listen(host: str, port: int, *, secure: bool) -> socket.socket:
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise PortBusyError(f"cannot serve the dashboard on {host}:{port}: {error.strerror}") from error
    except UnicodeError as error:  # a label of a name is empty or too long
        raise PortBusyError(f"cannot serve the dashboard on {host}:{port}: no address is called so") from error
    if not (secure or ipaddress.ip_address(str(place[0]).partition("%")[0]).is_loopback):
        raise UnguardedError(f"other machines may open the dashboard on {host} over HTTPS only")
    listener = socket.socket(family, kind, protocol)
    try:
        # As servers do: a port in TIME_WAIT is free, one that is listened on is not.
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(place)
        listener.listen(128)
        listener.setblocking(False)
    except OSError as error:
        listener.close()
        raise PortBusyError(f"cannot serve the dashboard on {host}:{port}: {error.strerror}") from error
    return listener
