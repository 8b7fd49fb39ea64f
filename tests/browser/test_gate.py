"""Who may open the dashboard, in a real browser: a foreign page, no link, an observer, another machine by HTTPS."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import pytest
import zstandard
from goshawk_dashboards.gate.client import CAMERA, open_page, viser_protocol
from goshawk_ground.pages.ports import free_port
from goshawk_proto import goshawk_pb2 as pb
from playwright.sync_api import Browser, BrowserContext, expect
from stage import Ground, Seen
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidMessage
from websockets.sync.client import connect
from websockets.sync.connection import Connection
from websockets.typing import Origin

Start = Callable[..., Ground]
Visit = Callable[..., Seen]
Watch = Callable[..., Seen]
VISER = viser_protocol()
PASSWORD = "correct horse battery"

ATTACK = """
async ({gate, ports, viser}) => {
  const tell = async (what) => { try { return String(await what()) } catch (error) { return "refused" } };
  const socket = (url) => new Promise((done) => {
    const found = new WebSocket(url, [viser]);
    found.onopen = () => done("open"); found.onerror = () => done("refused");
  });
  const found = {};
  found.read = await tell(async () => (await fetch(gate, {credentials: "include"})).text());
  found.post = await tell(async () => (await fetch(gate + "login", {method: "POST", credentials: "include",
    body: new URLSearchParams({password: "x"})})).text());
  for (const host of ["127.0.0.1", "localhost"])
    for (const port of ports) found[`socket ${host}:${port}`] = await socket(`ws://${host}:${port}/`);
  const blind = await fetch(gate, {mode: "no-cors", credentials: "include"}).catch(() => null);
  found.blind = blind === null ? "refused" : blind.type;
  const frame = document.createElement("iframe");
  frame.name = "inside"; document.body.append(frame);
  const form = document.createElement("form");
  Object.assign(form, {method: "post", action: gate + "login", target: "inside"});
  form.innerHTML = '<input name="password" value="correct horse battery">';
  document.body.append(form); form.submit();
  const page = document.createElement("iframe");
  page.src = gate; document.body.append(page);
  await new Promise((done) => setTimeout(done, 3000));
  return found;
}
"""


class _Page(BaseHTTPRequestHandler):
    """An empty page."""

    def do_GET(self) -> None:
        body = b"<!doctype html><title>evil</title><link rel=icon href='data:,'><body>"
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Says nothing."""


@pytest.fixture
def foreign() -> Iterator[int]:
    """The port of somebody else's pages on this machine: the nearest that a stranger's page can be."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), _Page)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield server.server_port
    server.shutdown()
    server.server_close()


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    """One person's browser: its pages share their cookies."""
    context = browser.new_context(viewport={"width": 1100, "height": 640}, ignore_https_errors=True)
    context.set_default_timeout(60_000)
    yield context
    context.close()


def listening(pid: int) -> set[int]:
    """The TCP ports on which a process waits for connections."""
    own = set[str]()
    for link in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile
            own.add(str(link.readlink()))
    found = set[int]()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in own:
                found.add(int(fields[1].rpartition(":")[2], 16))
    return found


def own_address() -> str:
    """An address of this machine that is not the loopback's."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing
        return probe.getsockname()[0]


def messages_of(connection: Connection) -> Iterator[dict[str, Any]]:
    """What viser tells a browser, message by message."""
    while True:
        data = connection.recv(timeout=30)
        assert isinstance(data, bytes)
        packed = data[16 : 16 + int.from_bytes(data[8:16], "little")]
        plain = zstandard.ZstdDecompressor().decompress(packed, int.from_bytes(data[:8], "little"))
        yield from msgspec.msgpack.decode(plain)["messages"]


def triggers(connection: Connection) -> tuple[bytes, bytes]:
    """The messages of a browser that commands: the stop key's, and a press of Start. Learnt by watching."""
    connection.send(msgspec.msgpack.encode(CAMERA))
    stop = start = None
    for message in messages_of(connection):
        if message["type"] == "RegisterCommandMessage" and message["props"]["label"] == "Stop":
            stop = {"type": "CommandTriggerMessage", "uuid": message["uuid"]}
        if message["type"] == "GuiButtonMessage" and message["props"]["label"] == "Start":
            start = {"type": "GuiUpdateMessage", "uuid": message["uuid"], "updates": {"value": True}}
        if stop is not None and start is not None:
            break
    return msgspec.msgpack.encode(stop), msgspec.msgpack.encode(start)


def flying(g: Ground) -> None:
    """Takes off, and waits until it tracks."""
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_READY, 20)
    assert g.link.start().accepted
    assert g.link.wait_for(lambda s: s.mode == pb.MODE_TRACK, 20)


def test_a_foreign_page_reads_nothing_opens_nothing_and_commands_nothing(
    ground: Start, context: BrowserContext, watch: Watch, foreign: int
) -> None:
    g = ground()
    page = watch(context.new_page()).page
    page.goto(g.dashboard.url)
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "ready")
    gate = urlsplit(g.dashboard.url)
    # The attack works where it comes from the right page: so the test would see it.
    own = page.evaluate(
        "viser => new Promise(done => {const s = new WebSocket(location.origin.replace('http', 'ws'), [viser]);"
        "s.onopen = () => done('open'); s.onerror = () => done('refused')})",
        VISER,
    )
    assert own == "open"
    ports = sorted(listening(os.getpid()))
    assert gate.port in ports
    given = {"gate": f"http://{gate.netloc}/", "ports": ports, "viser": VISER}
    # From the same site but another port the browser shows our cookie; from `localhost` it does not.
    for name in ("127.0.0.1", "localhost"):
        stranger = context.new_page()
        stranger.goto(f"http://{name}:{foreign}/")
        found = stranger.evaluate(ATTACK, given)
        assert found.pop("blind") in ("opaque", "refused")
        assert len(found) == 2 + 2 * len(ports)
        assert set(found.values()) == {"refused"}
        frames = [frame for frame in stranger.frames if frame.parent_frame is not None]
        assert len(frames) == 2
        for frame in frames:
            assert not frame.url.startswith(f"http://{gate.netloc}") or "Refused" in frame.content()
        stranger.close()
    assert g.link.snapshot().command is None
    assert g.link.snapshot().mode == pb.MODE_READY


def test_the_one_port_of_a_ground_station_is_the_gates_and_wants_a_session(station: Any) -> None:
    port = free_port(18800)
    process, facts = station("--port", str(port), "--connect", "tcp/127.0.0.1:1")
    ports = listening(process.pid)
    assert ports == {port}
    for origin in (None, Origin(f"http://127.0.0.1:{port}"), Origin("http://evil.example")):
        with pytest.raises((InvalidHandshake, InvalidMessage)):
            connect(f"ws://127.0.0.1:{port}/", origin=origin, subprotocols=[VISER])
    assert facts["url"].startswith(f"http://127.0.0.1:{port}/?token=")
    assert facts["observer_url"] != facts["url"]


def test_without_the_link_there_is_no_dashboard_but_what_to_do(
    ground: Start, context: BrowserContext, watch: Watch
) -> None:
    g = ground()
    page = watch(context.new_page(), expected="status of 401").page
    answer = page.goto(g.dashboard.url.partition("?")[0])
    assert answer is not None
    assert answer.status == 401
    expect(page.locator('[data-gate="sign-in"]')).to_contain_text("Open the link that the ground station printed")
    assert page.locator("script").count() == 0


def test_a_name_that_somebody_else_made_point_here_opens_nothing_even_with_the_link(
    ground: Start, context: BrowserContext, watch: Watch
) -> None:
    g = ground()
    page = watch(context.new_page(), expected="status of 421").page
    # Every name that ends so leads to this machine: a rebound name, as far as the browser knows.
    answer = page.goto(g.dashboard.url.replace("127.0.0.1", "evil.localhost"))
    assert answer is not None
    assert answer.status == 421
    expect(page.locator('[data-gate="refused"]')).to_contain_text("address that the ground station printed")
    assert context.cookies() == []


def test_the_link_opens_the_dashboard_leaves_the_address_and_makes_no_noise(
    ground: Start, context: BrowserContext, watch: Watch
) -> None:
    g = ground()
    seen = watch(context.new_page())
    page = seen.page
    page.goto(g.dashboard.url)
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "ready")
    expect(page.get_by_role("button", name="Start", exact=True)).to_be_visible()
    assert page.url == g.dashboard.url.partition("?")[0]
    (cookie,) = context.cookies()
    assert (cookie.get("httpOnly"), cookie.get("sameSite"), page.evaluate("document.cookie")) == (True, "Strict", "")
    assert seen.errors == []
    page.reload()
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "ready")


def test_an_observer_sees_the_flight_and_has_nothing_to_press(
    ground: Start, context: BrowserContext, watch: Watch
) -> None:
    g = ground(names=("alpha", "bravo"))
    flying(g)
    page = watch(context.new_page()).page
    page.goto(g.dashboard.observer_url)
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    expect(page.locator('[data-goshawk="strip"] [data-candidate]')).to_have_count(15)
    expect(page.get_by_role("button", name="Show", exact=True)).to_have_count(2)
    expect(page.get_by_role("button", name=re.compile("start|stop", re.IGNORECASE))).to_have_count(0)
    for key in ("Space", "Shift+Space"):
        page.keyboard.press(key)
    page.get_by_role("button", name="Show", exact=True).nth(1).click()
    expect(page.locator('[data-goshawk="fleet"] [data-vehicle="bravo"]')).to_have_attribute("data-shown", "true")
    page.keyboard.press("1")
    expect(page.locator('[data-goshawk="fleet"] [data-vehicle="alpha"]')).to_have_attribute("data-shown", "true")
    assert g.link.snapshot().mode == pb.MODE_TRACK


def test_a_command_that_an_observer_makes_by_hand_is_refused_and_the_operators_is_obeyed(ground: Start) -> None:
    g = ground()
    flying(g)
    with open_page(g.dashboard.url) as allowed:
        stop, start = triggers(allowed)
        with open_page(g.dashboard.observer_url) as crafted:
            crafted.send(msgspec.msgpack.encode(CAMERA))
            # Such messages an observer may send, as he shows another vehicle by them, but his server knows no such key
            # and no such button.
            crafted.send(start)
            crafted.send(stop)
            crafted.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
            with pytest.raises(ConnectionClosed) as closed:
                while True:
                    crafted.recv(timeout=30)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1008
        assert g.link.snapshot().mode == pb.MODE_TRACK

        allowed.send(stop)
        assert g.link.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 20)


def test_another_machine_logs_in_over_https_and_wrong_passwords_are_slowed(
    ground: Start, context: BrowserContext, watch: Watch, station: Any, tmp_path: Path
) -> None:
    g = ground()
    flying(g)
    for name, text in (("operator", PASSWORD), ("observer", "staple in the barn")):
        (tmp_path / name).touch(mode=0o600)
        (tmp_path / name).write_text(text)
    port, address = free_port(18900), own_address()
    assert not address.startswith("127.")
    _, facts = station(
        "--host", "0.0.0.0", "--port", str(port), "--connect", g.link.snapshot().endpoint,
        "--operator-password-file", str(tmp_path / "operator"), "--observer-password-file", str(tmp_path / "observer"),
    )  # fmt: skip
    shown = ssl.PEM_cert_to_DER_cert(ssl.get_server_certificate((address, port)))
    assert facts["fingerprint"] == hashlib.sha256(shown).digest().hex(":").upper()
    assert "operator_password" not in facts
    page = watch(context.new_page(), expected="status of (401|403|429)").page
    page.goto(f"https://{address}:{port}/")
    trouble = page.locator('[data-gate="trouble"]')

    def log_in(password: str) -> None:
        page.get_by_label("Password").fill(password)
        page.get_by_role("button", name="Log in").click()

    log_in("a wrong password")
    expect(trouble).to_contain_text("not the password")
    deadline = time.monotonic() + 60
    while "Too many attempts" not in trouble.inner_text():
        assert time.monotonic() < deadline, "wrong passwords were never slowed"
        answers = page.evaluate(
            "() => Promise.all([...Array(8)].map(() => fetch('/login', {method: 'POST', "
            "body: new URLSearchParams({password: 'wrong'})}).then(r => r.status)))"
        )
        assert set(answers) <= {403, 429}
        log_in("wrong again")
        trouble.wait_for()
    while page.locator('[data-gate="login"]').count():
        assert time.monotonic() < deadline, "the right password was never taken"
        time.sleep(1.5)
        log_in("staple in the barn")
        page.wait_for_load_state()
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    expect(page.get_by_role("button", name=re.compile("start|stop", re.IGNORECASE))).to_have_count(0)

    context.clear_cookies()
    page.goto(f"https://{address}:{port}/")
    log_in(PASSWORD)
    expect(page.locator('[data-goshawk="status"]')).to_have_attribute("data-mode", "track")
    (cookie,) = context.cookies()
    assert cookie.get("secure") is True
    page.get_by_role("button", name="Stop", exact=True).click()
    assert g.link.wait_for(lambda s: s.mode in (pb.MODE_STOPPING, pb.MODE_LANDED), 30)
