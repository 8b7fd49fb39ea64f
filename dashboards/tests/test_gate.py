"""A gate on a real port before a real viser server, met by clients that are no browsers."""

from __future__ import annotations

import http.client
import socket
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress

import numpy as np
import pytest
import zstandard
from aiohttp import web
from goshawk_dashboards.gate import Access, Addition, Gate, Role, UnguardedError, doors
from goshawk_dashboards.gate.client import cookie_for, viser_protocol
from goshawk_dashboards.page.serving import close_server, open_server
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

PASSWORD = "correct horse battery"
VISER = [viser_protocol()]


async def echo(browser: web.WebSocketResponse) -> None:
    """Says what it hears."""
    async for message in browser:
        await browser.send_str(message.data)


class House:
    """A gate, the viser server behind it, and how one comes to it."""

    def __init__(self) -> None:
        self.gate = Gate(host="127.0.0.1", port=0, access=Access(passwords={Role.OPERATOR: PASSWORD}))
        addition = Addition(foot="<script>// ours</script>", path="/own", talk=echo)
        self.server = open_server(self.gate, Role.OPERATOR, "test", addition)
        self.host = f"127.0.0.1:{self.gate.port}"

    def ask(
        self, method: str = "GET", path: str = "/", body: str | None = None, **headers: str
    ) -> tuple[int, str, str]:
        """Status, text and the cookie that it gives."""
        asked = http.client.HTTPConnection("127.0.0.1", self.gate.port, timeout=20)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        asked.request(method, path, body, named)
        answer = asked.getresponse()
        text = answer.read().decode()
        asked.close()
        return answer.status, text, answer.headers.get("Set-Cookie", "").partition(";")[0]

    def cookie(self) -> str:
        """Of a session that the operator's link began."""
        return cookie_for(self.gate.link(Role.OPERATOR))

    def open(self, cookie: str, queue: int = 16, path: str = "/", **changes: str) -> ClientConnection:
        """A WebSocket as the dashboard's page opens it."""
        shown = {"Cookie": cookie, **changes}
        return connect(
            f"ws://{self.host}{path}",
            origin=Origin(shown.pop("Origin", f"http://{self.host}")),
            subprotocols=VISER,
            additional_headers=shown,
            max_size=None,
            max_queue=queue,
            compression=None,
        )


@pytest.fixture
def house() -> Iterator[House]:
    """Open."""
    house = House()
    yield house
    close_server(house.server)
    house.gate.close()


def test_the_page_and_its_websocket_need_a_session(house: House) -> None:
    assert house.ask()[0] == 401
    with pytest.raises(InvalidStatus, match="401"):
        house.open("")
    cookie = house.cookie()
    status, text, _ = house.ask(Cookie=cookie)
    assert (status, "viser" in text.lower()) == (200, True)
    with house.open(cookie) as page:
        assert len(page.recv(timeout=20)) > 16


def test_what_a_dashboard_adds_stands_at_the_end_of_the_page_and_behind_the_same_door(house: House) -> None:
    cookie = house.cookie()
    _, text, _ = house.ask(Cookie=cookie)
    assert text.index('<div id="root">') < text.index("<script>// ours</script></body>")
    with house.open(cookie, path="/own") as own:
        own.send("well?")
        assert own.recv(timeout=20) == "well?"
    with pytest.raises(InvalidStatus, match="401"):
        house.open("", path="/own")
    with pytest.raises(InvalidStatus, match="403"):
        house.open(cookie, path="/own", Origin="http://evil.example")


@pytest.mark.parametrize("origin", ["http://evil.example", "http://127.0.0.1:1", "null"])
def test_a_foreign_origin_gets_no_websocket_with_our_own_cookie(house: House, origin: str) -> None:
    cookie = house.cookie()
    with pytest.raises(InvalidStatus, match="403"):
        house.open(cookie, Origin=origin)


def test_a_name_of_somebody_elses_gets_nothing_with_our_own_cookie(house: House) -> None:
    assert house.ask(Host="evil.example", Cookie=house.cookie())[0] == 421


def test_a_wrong_link_and_an_unknown_method_are_refused(house: House) -> None:
    assert house.ask(path="/?token=wrong")[0] == 403
    assert house.ask("PUT", Cookie=house.cookie())[0] == 405


def test_words_in_the_address_do_not_reach_the_page(house: House) -> None:
    # viser's page would take another server's address from there, and that server's scripts.
    assert house.ask(path="/?websocket=ws://evil.example", Cookie=house.cookie())[0] == 303


def test_a_login_is_taken_from_our_own_page_only_and_wrong_ones_are_slowed(house: House) -> None:
    own, right = {"Origin": f"http://{house.host}"}, f"password={PASSWORD.replace(' ', '+')}"
    assert house.ask("POST", "/login", right, Origin="http://evil.example")[0] == 403
    assert house.ask("POST", "/login", "x" * 5000, **own)[0] == 413
    status, _, cookie = house.ask("POST", "/login", right, **own)
    assert (status, house.ask(Cookie=cookie)[0]) == (303, 200)
    statuses = [house.ask("POST", "/login", "password=wrong", **own)[0] for _ in range(12)]
    assert set(statuses) == {403, 429}
    deadline = time.monotonic() + 60
    while house.ask("POST", "/login", right, **own)[0] != 303:
        assert time.monotonic() < deadline, "the right password was never taken again"
        time.sleep(0.3)


def test_other_machines_without_https_are_refused() -> None:
    with pytest.raises(UnguardedError, match="HTTPS only"):
        Gate(host="0.0.0.0", port=0, access=Access())


def test_silent_connections_in_any_number_keep_nobody_out(house: House) -> None:
    with ExitStack() as stack:
        for _ in range(300):
            stack.enter_context(socket.create_connection(("127.0.0.1", house.gate.port), timeout=20))
        cookie = house.cookie()
        assert house.ask(Cookie=cookie)[0] == 200
        with house.open(cookie) as page:
            assert page.recv(timeout=20)


def test_half_a_request_is_waited_for_in_bounds(house: House, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doors, "ASK_WITHIN_S", 0.2)
    with socket.create_connection(("127.0.0.1", house.gate.port), timeout=20) as slow:
        slow.sendall(b"GET / HTTP/1.1\r\nHost: loc")
        assert slow.recv(100) == b""


def test_logins_whose_form_never_comes_keep_nobody_out_and_end(house: House, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = f"POST /login HTTP/1.1\r\nHost: {house.host}\r\nOrigin: http://{house.host}\r\nContent-Length: 30\r\n\r\np"
    with ExitStack() as stack:
        slow = [stack.enter_context(socket.create_connection(("127.0.0.1", house.gate.port), 20)) for _ in range(100)]
        for connection in slow:
            connection.sendall(begun.encode())
        # The door holds fewer: the first had to go without an answer, long before its time was over.
        assert slow[0].recv(100) == b""
        assert house.ask(Cookie=house.cookie())[0] == 200
    monkeypatch.setattr(doors, "ASK_WITHIN_S", 0.2)
    with socket.create_connection(("127.0.0.1", house.gate.port), timeout=20) as late:
        late.sendall(begun.encode())
        assert late.recv(100) == b""


def test_a_packed_form_is_refused(house: House) -> None:
    own = {"Origin": f"http://{house.host}", "Content_Encoding": "gzip"}
    assert house.ask("POST", "/login", "password=no-gzip-at-all", **own)[0] == 413


def test_headers_without_end_are_refused(house: House) -> None:
    with socket.create_connection(("127.0.0.1", house.gate.port), timeout=20) as big:
        with suppress(OSError):
            big.sendall(b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * 100_000 + b"\r\n\r\n")
        with suppress(ConnectionResetError):
            assert b" 400 " in big.recv(1000).splitlines()[0]


def test_one_address_opens_so_many_pages_and_no_more(house: House) -> None:
    cookie = house.cookie()
    with ExitStack() as stack:
        for _ in range(doors.MOST_OPEN_OF_ONE):
            stack.enter_context(house.open(cookie))
        with pytest.raises(InvalidStatus, match="503"):
            house.open(cookie)
    deadline = time.monotonic() + 30
    while house.ask(Cookie=cookie)[0] != 200:
        assert time.monotonic() < deadline, "closed pages go on counting"


def test_a_message_that_is_too_long_ends_that_page_alone(house: House) -> None:
    cookie = house.cookie()
    with house.open(cookie) as other, house.open(cookie) as page:
        other.recv(timeout=20)
        with pytest.raises(ConnectionClosed):  # it may come while the page still sends
            page.send(b"\x00" * (2 << 20))
            while True:
                page.recv(timeout=20)
        house.server.scene.add_frame("/still")
        assert other.recv(timeout=20)


def test_a_browser_that_reads_nothing_holds_up_no_other(house: House) -> None:
    cookie = house.cookie()
    cloud = house.server.scene.add_point_cloud("/cloud", np.zeros((100_000, 3)), np.zeros((100_000, 3)))
    # Its own reader stops after one message, as a browser's does that hangs.
    with house.open(cookie) as reads, house.open(cookie, queue=1):
        for k in range(40):  # 24 MB, far beyond every buffer between viser and a browser
            cloud.points = np.full((100_000, 3), float(k), dtype=np.float32)
            house.server.flush()
            time.sleep(0.02)
        house.server.gui.add_html("the last word")
        deadline = time.monotonic() + 60
        seen = b""
        while b"the last word" not in seen:
            assert time.monotonic() < deadline, "the other browser was held up"
            data = reads.recv(timeout=60)
            assert isinstance(data, bytes)
            packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
            seen = zstandard.ZstdDecompressor().decompress(packed, int.from_bytes(data[:8], "little"))
