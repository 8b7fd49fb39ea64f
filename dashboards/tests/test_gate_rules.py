"""What the gate makes of headers, secrets, cookies and certificates, without a socket."""

from __future__ import annotations

import datetime as dt
import math
from pathlib import Path
from typing import Any

import msgspec
import pytest
from cryptography import x509
from goshawk_dashboards.gate import Access, CertificateError, Role, SecretError
from goshawk_dashboards.gate.access import SESSION_S, Attempts, key_from, new_password, password_from
from goshawk_dashboards.gate.certificate import kept_in, load
from goshawk_dashboards.gate.client import CAMERA
from goshawk_dashboards.gate.headers import address_key, host_is_ours, is_own_page
from goshawk_dashboards.gate.relay import RefusedError, check_observed
from hypothesis import given
from hypothesis import strategies as st

NAMES = {"localhost", "ground"}


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:8080", "LOCALHOST:9000", "127.0.0.1:8080", "ground:8080", "localhost.:8080"]
)
def test_our_own_names_are_ours_whatever_the_port_of_a_tunnel(host: str) -> None:
    assert host_is_ours(host, "127.0.0.1", NAMES)


@pytest.mark.parametrize(
    "host",
    [
        "", "evil.example", "evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example:8080", "127.0.0.2",
        "user@localhost", "localhost:port", "localhost/..", "localhost:8080@evil.example", "2130706433", "[::1]",
    ],
)  # fmt: skip
def test_a_name_that_was_made_to_point_here_is_not_ours(host: str) -> None:
    assert not host_is_ours(host, "127.0.0.1", NAMES)


def test_an_address_of_ipv6_is_ours_with_its_brackets() -> None:
    assert host_is_ours("[::1]:8080", "::1", NAMES)
    assert host_is_ours("192.168.1.4:8080", "::ffff:192.168.1.4", NAMES)
    assert not host_is_ours("[::2]:8080", "::1", NAMES)


@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "http://localhost:9999", "https://localhost:8080", "http://localhost", "null", "", "x"],
)
def test_only_the_origin_that_was_called_is_our_own_page(origin: str) -> None:
    shown = {"Host": "localhost:8080", "Origin": origin}
    assert not is_own_page(shown, "http", origin_needed=True)
    assert is_own_page({**shown, "Origin": "http://localhost:8080"}, "http", origin_needed=True)


def test_a_websocket_without_an_origin_is_nobodys_page() -> None:
    assert not is_own_page({"Host": "localhost:8080"}, "http", origin_needed=True)


@pytest.mark.parametrize("near", ["cross-site", "same-site", "none"])
def test_a_form_of_another_site_is_refused_even_with_our_origin(near: str) -> None:
    shown = {"Host": "localhost:8080", "Origin": "http://localhost:8080", "Sec-Fetch-Site": near}
    assert not is_own_page(shown, "http", origin_needed=True)


def test_a_house_in_ipv6_counts_as_one_address() -> None:
    assert address_key("2001:db8:1:2:3::9") == address_key("2001:db8:1:2:ffff::1%eth0")
    assert address_key("::ffff:10.0.0.1") == address_key("10.0.0.1") != address_key("10.0.0.2")


def test_each_role_has_a_token_of_its_own_and_each_start_others() -> None:
    access = Access()
    assert {access.role_of_token(access.token(role)) for role in Role} == set(Role)
    assert access.token(Role.OPERATOR) != access.token(Role.OBSERVER)
    assert Access().role_of_token(access.token(Role.OPERATOR)) is None
    assert access.role_of_token("") is None


@given(st.text())
def test_no_made_up_text_is_a_token_a_password_or_a_session(text: str) -> None:
    access = Access(passwords={Role.OPERATOR: "correct horse battery"})
    assert access.role_of_token(text) is None
    assert access.role_of_password(text) is None
    assert access.session_of(text, 0.0) is None
    assert access.session_of(f"{text}\udcff.1.2.3", 0.0) is None, "a cookie may hold any bytes"


def test_a_session_ends_after_a_day_and_cannot_be_promoted() -> None:
    access = Access()
    cookie = access.new_cookie(Role.OBSERVER, 1000.0)
    session = access.session_of(cookie, 1001.0)
    assert session is not None
    assert session.role is Role.OBSERVER
    assert access.session_of(cookie, 1000.0 + SESSION_S) is None
    assert access.session_of(cookie.replace("observer", "operator"), 1001.0) is None


def test_a_password_opens_its_role() -> None:
    access = Access(passwords={Role.OPERATOR: "correct horse battery", Role.OBSERVER: "staple in the barn"})
    assert access.role_of_password("correct horse battery") is Role.OPERATOR
    assert access.role_of_password("staple in the barn") is Role.OBSERVER
    assert access.role_of_password("correct horse batter") is None


def test_attempts_are_five_at_once_then_one_a_second_for_each_address_alone() -> None:
    now_s = 0.0
    attempts = Attempts(lambda: now_s)
    assert [attempts.may("10.0.0.1") for _ in range(7)] == [True] * 5 + [False] * 2
    assert attempts.may("10.0.0.2")
    now_s = 1.0
    assert [attempts.may("10.0.0.1") for _ in range(2)] == [True, False]


def test_hammering_does_not_put_off_the_next_attempt() -> None:
    now_s = 0.0
    attempts = Attempts(lambda: now_s)
    for _ in range(1000):
        attempts.may("10.0.0.1")
    now_s = 1.0
    assert attempts.may("10.0.0.1")


def test_a_token_file_is_made_for_its_owner_alone_and_keeps_the_key(tmp_path: Path) -> None:
    path = tmp_path / "token"
    assert key_from(path) == key_from(path)
    assert path.stat().st_mode & 0o077 == 0
    path.chmod(0o644)
    with pytest.raises(SecretError, match="chmod 600"):
        key_from(path)


def test_a_bad_password_file_is_one_line_that_says_what_to_do(tmp_path: Path) -> None:
    path = tmp_path / "password"
    with pytest.raises(SecretError, match="No such file"):
        password_from(path)
    path.touch(mode=0o600)
    for text, said in (("short", "use 12 or more"), ("two lines of\nsecret words", "more than one line")):
        path.write_text(text)
        with pytest.raises(SecretError, match=said):
            password_from(path)
    path.write_bytes(b"\xff\xfe\xff\xfe")
    with pytest.raises(SecretError, match="not text"):
        password_from(path)
    path.write_text(f"{new_password()}\n")
    assert len(password_from(path)) == 23


def test_our_certificate_is_kept_from_start_to_start_and_its_key_private(tmp_path: Path) -> None:
    first = kept_in(tmp_path / "goshawk", ["ground", "192.168.1.4"])
    assert kept_in(tmp_path / "goshawk", ["ground"]).fingerprint == first.fingerprint
    assert first.names == {"ground"}
    assert (tmp_path / "goshawk/dashboard-key.pem").stat().st_mode & 0o077 == 0
    made = x509.load_pem_x509_certificate((tmp_path / "goshawk/dashboard-certificate.pem").read_bytes())
    assert made.not_valid_after_utc > dt.datetime.now(dt.UTC) + dt.timedelta(days=300)


def test_a_certificate_that_cannot_serve_is_one_line(tmp_path: Path) -> None:
    kept_in(tmp_path / "one", ["ground"])
    kept_in(tmp_path / "two", ["ground"])
    certificate, key = tmp_path / "one/dashboard-certificate.pem", tmp_path / "one/dashboard-key.pem"
    with pytest.raises(CertificateError, match="is not the key of"):
        load(certificate, tmp_path / "two/dashboard-key.pem")
    with pytest.raises(CertificateError, match="no certificate in PEM"):
        load(key, key)
    with pytest.raises(CertificateError, match="No such file"):
        load(tmp_path / "none", key)


@pytest.mark.parametrize("kind", ["ShareUrlRequest", "FileTransferPart", "GuiFormSubmitMessage"])
def test_an_observer_may_not_send_what_shares_uploads_or_submits(kind: str) -> None:
    with pytest.raises(RefusedError):
        check_observed(msgspec.msgpack.encode({"type": kind, "uuid": "1"}))
    check_observed(msgspec.msgpack.encode(CAMERA))


@pytest.mark.parametrize(
    "changed",
    [
        {"position": (1.0, 2.0)},
        {"position": (1.0, math.nan, 2.0)},
        {"look_at": "abc"},
        {"look_at": (0.0, 0.0, math.inf)},
        {"wxyz": (1.0, 0.0, 0.0)},
        {"up_direction": None},
        {"image_height": "900"},
    ],
)
def test_a_camera_of_an_observer_that_is_nowhere_is_refused(changed: dict[str, Any]) -> None:
    with pytest.raises(RefusedError):
        check_observed(msgspec.msgpack.encode(CAMERA | changed))


@given(st.binary(max_size=200))
def test_no_rubbish_of_an_observer_is_handed_on(data: bytes) -> None:
    with pytest.raises(RefusedError):
        check_observed(data)
