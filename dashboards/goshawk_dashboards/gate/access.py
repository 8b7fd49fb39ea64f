"""Roles, links, passwords and sessions: what a visitor shows, and what it makes of him.

Nothing is kept for a session: its cookie is signed. A ground station that starts again with the same key (a token
file) so knows its browsers again, and an operator's open page finds back to Stop by itself.
"""

from __future__ import annotations

import base64
import hashlib
import hmac
import os
import secrets
import stat
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

SESSION_S = 24 * 3600.0
KEY_BYTES = 32
LEAST_PASSWORD = 12
"""Characters of a password from a file. With one attempt a second nobody guesses as many."""
ATTEMPTS_AT_ONCE = 5
ATTEMPTS_HZ = 1.0
MOST_ADDRESSES = 4096


class Role(StrEnum):
    """What a visitor may do."""

    OPERATOR = "operator"
    OBSERVER = "observer"


class SecretError(OSError):
    """A file with a secret cannot be used; one line says why and what to do."""


def new_password() -> str:
    """Twenty characters for a person to type, 95 bits, none of which looks like another."""
    letters = "abcdefghjkmnpqrstuvwxyz23456789"
    return "-".join("".join(secrets.choice(letters) for _ in range(5)) for _ in range(4))


@dataclass(frozen=True, kw_only=True)
class Session:
    """Who a visitor is, and until when (seconds since 1970)."""

    role: Role
    until_s: float


@dataclass(frozen=True, kw_only=True)
class Access:
    """The secrets of one gate. ``passwords`` empty: nobody logs in, the links alone open it."""

    key: bytes = field(default_factory=lambda: secrets.token_bytes(KEY_BYTES), repr=False)
    passwords: Mapping[Role, str] = field(default_factory=dict[Role, str], repr=False)

    def token(self, role: Role) -> str:
        """What the link of a role carries."""
        return _text(self._mac(f"link {role}"))

    def role_of_token(self, token: str) -> Role | None:
        """Whose link it is, or nobody's."""
        return self._first(token, {role: self.token(role) for role in Role})

    def role_of_password(self, password: str) -> Role | None:
        """Whose password it is, or nobody's."""
        return self._first(password, self.passwords)

    def new_cookie(self, role: Role, now_s: float) -> str:
        """A session that begins now."""
        facts = f"{role}.{now_s + SESSION_S:.0f}.{secrets.token_urlsafe(9)}"
        return f"{facts}.{_text(self._mac(f'session {facts}'))}"

    def session_of(self, cookie: str, now_s: float) -> Session | None:
        """The session that a cookie stands for, if it is ours and not over."""
        facts, _, mark = cookie.rpartition(".")
        if not _same(mark, _text(self._mac(f"session {facts}"))):
            return None
        role, until, _ = facts.split(".")
        session = Session(role=Role(role), until_s=float(until))
        return session if now_s < session.until_s else None

    def _mac(self, text: str) -> bytes:
        return hmac.digest(self.key, text.encode(errors="replace"), "sha256")

    def _first(self, shown: str, wanted: Mapping[Role, str]) -> Role | None:
        # Each is compared whatever the others gave: the time tells nothing.
        found = [role for role, secret in wanted.items() if _same(self._digest(shown), self._digest(secret))]
        return found[0] if found else None

    def _digest(self, text: str) -> str:
        return hmac.new(self.key, text.encode(errors="replace"), hashlib.sha256).hexdigest()


class Attempts:
    """How many passwords an address may try: a few at once, then one a second.

    Nobody is shut out for longer than that second, and never for what another address did.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._spent: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def may(self, address: str) -> bool:
        """Whether it may try one now, which counts as tried."""
        now_s = self._clock()
        spent, since_s = self._spent.pop(address, (0.0, now_s))
        spent = max(0.0, spent - (now_s - since_s) * ATTEMPTS_HZ)
        allowed = spent <= ATTEMPTS_AT_ONCE - 1.0
        self._spent[address] = (spent + 1.0 if allowed else spent, now_s)
        while len(self._spent) > MOST_ADDRESSES:
            self._spent.popitem(last=False)
        return allowed


def key_from(path: Path) -> bytes:
    """The key that a token file holds; a file that does not exist is made. Raises SecretError."""
    if not path.exists():
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                file.write(secrets.token_urlsafe(KEY_BYTES) + "\n")
        except OSError as error:
            raise SecretError(f"cannot make the token file {path}: {error.strerror}") from error
    text = _secret_line(path, "token file")
    if len(text) < KEY_BYTES:
        raise SecretError(f"the token file {path} holds {len(text)} characters, {KEY_BYTES} are needed: remove it")
    return hashlib.sha256(text.encode()).digest()


def password_from(path: Path) -> str:
    """The password in a file's only line. Raises SecretError."""
    text = _secret_line(path, "password file")
    if len(text) < LEAST_PASSWORD:
        raise SecretError(f"the password in {path} has {len(text)} characters; use {LEAST_PASSWORD} or more")
    return text


def _secret_line(path: Path, what: str) -> str:
    try:
        mode = path.stat().st_mode
        if mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise SecretError(f"others may read the {what} {path}: chmod 600 {path}")
        text = path.read_text(encoding="utf-8").strip()
    except UnicodeDecodeError as error:
        raise SecretError(f"the {what} {path} is not text") from error
    except SecretError:
        raise
    except OSError as error:
        raise SecretError(f"cannot read the {what} {path}: {error.strerror}") from error
    if "\n" in text:
        raise SecretError(f"the {what} {path} has more than one line")
    return text


def _same(shown: str, wanted: str) -> bool:
    return hmac.compare_digest(shown.encode(errors="replace"), wanted.encode())


def _text(mac: bytes) -> str:
    return base64.urlsafe_b64encode(mac).rstrip(b"=").decode("ascii")
