"""From the gate to viser and back: its page, and its WebSocket, message by message.

Neither side is read faster than the other takes: a slow browser slows its own messages, which viser merges meanwhile,
and nobody else's.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import aiohttp
import msgspec
from aiohttp import WSMsgType, web

from goshawk_dashboards.gate.access import Role, Session

MOST_MESSAGE_BYTES = 1 << 20
"""From a browser: it sends clicks and where the camera is."""
TAKE_WITHIN_S = 30.0
"""How long a browser may take for one message before it counts as dead."""
HEARTBEAT_S = 15.0
OBSERVER_MAY = frozenset({"ViewerCameraMessage", "GuiUpdateMessage", "CommandTriggerMessage"})
"""What a browser of an observer may tell viser: where its camera is, and what it wants to see, by buttons or keys.
There is nothing else behind it: the observers' viser server knows no Start and no Stop."""
OBSERVER_HZ, OBSERVER_AT_ONCE = 200.0, 100.0


class _Kind(msgspec.Struct):
    """The one field of viser's messages that is looked at."""

    type: str


_Vector = tuple[float, float, float]


class _Camera(msgspec.Struct):
    """What dashboards read of where a camera is: viser takes lists of any length."""

    wxyz: tuple[float, float, float, float]
    position: _Vector
    look_at: _Vector
    up_direction: _Vector
    image_width: int
    image_height: int


_decode_kind = msgspec.msgpack.Decoder(_Kind).decode
_decode_camera = msgspec.msgpack.Decoder(_Camera).decode


@dataclass(frozen=True, kw_only=True)
class Addition:
    """What a dashboard has of its own beside viser's page."""

    foot: str
    """HTML at the end of the page."""
    path: str = ""
    """Where its script opens a WebSocket; empty: nowhere."""
    talk: Callable[[web.WebSocketResponse], Awaitable[None]] | None = None
    """Speaks over one that has been opened, in the gate's loop, until it ends."""


class RefusedError(Exception):
    """A message that this browser may not send."""


class Upstream:
    """A viser server behind the gate. Made and used in the gate's loop."""

    def __init__(self, socket_path: str, addition: Addition | None = None) -> None:
        self._addition = addition
        self._client = aiohttp.ClientSession(
            connector=aiohttp.UnixConnector(socket_path, limit=0, force_close=True), auto_decompress=False
        )

    async def close(self) -> None:
        """Ends every connection to it."""
        await self._client.close()

    async def get(self, request: web.BaseRequest) -> web.Response:
        """One of viser's files."""
        ours = self._addition if request.path == "/" else None
        packed = ours is None and "gzip" in request.headers.get("Accept-Encoding", "")
        wanted = {"Accept-Encoding": "gzip" if packed else "identity"}
        async with self._client.get(f"http://viser{request.rel_url.raw_path}", headers=wanted) as found:
            kept = {k: found.headers[k] for k in ("Content-Type", "Content-Encoding") if k in found.headers}
            body = await found.read()
        if ours is not None:
            before, end, after = body.rpartition(b"</body>")
            body = before + ours.foot.encode() + end + after
        answer = web.Response(status=found.status, body=body, headers=kept)
        if not packed:
            answer.enable_compression()
        return answer

    async def talk(self, request: web.BaseRequest, session: Session) -> web.StreamResponse | None:
        """The dashboard's own WebSocket, until it or the session ends; None: the browser asks for another one."""
        if self._addition is None or self._addition.talk is None or request.path != self._addition.path:
            return None
        browser = web.WebSocketResponse(
            max_msg_size=MOST_MESSAGE_BYTES, compress=False, heartbeat=HEARTBEAT_S, timeout=2.0
        )
        await browser.prepare(request)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._addition.talk(browser), session.until_s - time.time())
        await browser.close()
        return browser

    async def pair(self, request: web.BaseRequest, session: Session) -> web.StreamResponse:
        """Joins the browser's WebSocket to viser's until one of them ends, or the session does."""
        offered = [p.strip() for p in request.headers.get("Sec-WebSocket-Protocol", "").split(",")]
        protocols = [p for p in offered if p.startswith("viser-v")]
        async with self._client.ws_connect("http://viser/", protocols=protocols, max_msg_size=0, compress=0) as viser:
            browser = web.WebSocketResponse(
                protocols=protocols, max_msg_size=MOST_MESSAGE_BYTES, compress=False, heartbeat=HEARTBEAT_S, timeout=2.0
            )
            await browser.prepare(request)
            ways = [
                asyncio.create_task(_down(viser, browser)),
                asyncio.create_task(_up(browser, viser, session.role)),
            ]
            try:
                await asyncio.wait(ways, timeout=session.until_s - time.time(), return_when=asyncio.FIRST_COMPLETED)
            finally:
                for way in ways:
                    way.cancel()
                ended = await asyncio.gather(*ways, return_exceptions=True)
            refused = any(isinstance(end, RefusedError) for end in ended)
            code = (
                aiohttp.WSCloseCode.POLICY_VIOLATION if refused else viser.close_code or aiohttp.WSCloseCode.GOING_AWAY
            )
            await browser.close(code=code)
            return browser


async def _down(viser: aiohttp.ClientWebSocketResponse, browser: web.WebSocketResponse) -> None:
    async for message in viser:
        if message.type is WSMsgType.BINARY:
            async with asyncio.timeout(TAKE_WITHIN_S):
                await browser.send_bytes(message.data)


async def _up(browser: web.WebSocketResponse, viser: aiohttp.ClientWebSocketResponse, role: Role) -> None:
    pace = _Pace()
    async for message in browser:
        if message.type is not WSMsgType.BINARY:
            raise RefusedError
        if role is not Role.OPERATOR:
            check_observed(message.data)
            await pace.wait()
        await viser.send_bytes(message.data)


def check_observed(data: bytes) -> None:
    """Raises RefusedError for a message that an observer may not send, or that is none."""
    try:
        kind = _decode_kind(data).type
        if kind not in OBSERVER_MAY:
            raise RefusedError
        camera = _decode_camera(data) if kind == "ViewerCameraMessage" else None
    except msgspec.MsgspecError as error:
        raise RefusedError from error
    if camera is not None:
        numbers = (*camera.wxyz, *camera.position, *camera.look_at, *camera.up_direction)
        if not all(map(math.isfinite, numbers)):
            raise RefusedError


class _Pace:
    """Holds an observer to so many messages a second: what is more waits in his own connection."""

    def __init__(self) -> None:
        self._left, self._since_s = OBSERVER_AT_ONCE, time.monotonic()

    async def wait(self) -> None:
        now_s = time.monotonic()
        self._left = min(OBSERVER_AT_ONCE, self._left + (now_s - self._since_s) * OBSERVER_HZ) - 1.0
        self._since_s = now_s
        if self._left < 0.0:
            await asyncio.sleep(-self._left / OBSERVER_HZ)
