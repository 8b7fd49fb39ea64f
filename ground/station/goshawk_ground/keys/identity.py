"""One holder's folder: `ca.pem`, `cert.pem`, `key.pem`, and on a vehicle `access.toml`, for a person `revoked.toml`.

`access.toml` names the operators and observers that the vehicle admits. `revoked.toml` names the vehicles that were
stolen or lost, which a ground refuses to talk to. Both are short and may be edited by hand.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from cryptography import x509

from goshawk_ground.keys.authority import Pair, check_pair, check_signed, holder_of, read_cert, read_key
from goshawk_ground.keys.names import Holder, KeysError, Role

CA, CERT, KEY, ACCESS, REVOKED = "ca.pem", "cert.pem", "key.pem", "access.toml", "revoked.toml"
FILES = (CA, CERT, KEY, ACCESS, REVOKED)


@dataclass(frozen=True, kw_only=True)
class Access:
    """Whom a vehicle admits, by name."""

    operators: frozenset[str] = frozenset()
    observers: frozenset[str] = frozenset()

    def admits(self, who: Holder) -> bool:
        """Whether this person may connect; no vehicle may."""
        return who.name in self._of(who.role)

    def plus(self, who: Holder) -> Access:
        """With this person admitted."""
        return self._with(who.role, self._of(who.role) | {who.name})

    def minus(self, who: Holder) -> Access:
        """Without this person."""
        return self._with(who.role, self._of(who.role) - {who.name})

    def _of(self, role: Role) -> frozenset[str]:
        return {Role.OPERATOR: self.operators, Role.OBSERVER: self.observers}.get(role, frozenset())

    def _with(self, role: Role, names: frozenset[str]) -> Access:
        if role is Role.OPERATOR:
            return Access(operators=names, observers=self.observers)
        return Access(operators=self.operators, observers=names)

    def toml(self) -> str:
        """The file's text."""
        return (
            "# Whom this vehicle admits: operators start, stop and see, observers see.\n"
            f"operators = {json.dumps(sorted(self.operators))}\nobservers = {json.dumps(sorted(self.observers))}\n"
        )


@dataclass(frozen=True, kw_only=True)
class Identity:
    """A folder that was read and found whole."""

    folder: Path
    who: Holder
    cert: x509.Certificate
    authority: x509.Certificate
    access: Access
    """Of a vehicle; empty for a person."""
    revoked: frozenset[str]
    """Of a person: the vehicles not to talk to; empty for a vehicle."""


def read_identity(folder: Path) -> Identity:
    """Reads a folder and checks that key, certificate and authority belong together; raises KeysError."""
    where = str(folder)
    cert = read_cert(_bytes(folder / CERT), f"{folder / CERT}")
    authority = read_cert(_bytes(folder / CA), f"{folder / CA}")
    check_pair(Pair(cert=cert, key=read_key(_bytes(folder / KEY), f"{folder / KEY}")), where)
    check_signed(cert, authority, where)
    who = holder_of(cert, where)
    is_vehicle = who.role is Role.VEHICLE
    return Identity(
        folder=folder,
        who=who,
        cert=cert,
        authority=authority,
        access=read_access(folder) if is_vehicle else Access(),
        revoked=frozenset() if is_vehicle else revoked_vehicles(folder),
    )


def read_access(folder: Path) -> Access:
    """A vehicle's `access.toml`; raises KeysError."""
    facts = _toml(folder / ACCESS)
    lists = {name: _names(facts, name, folder / ACCESS) for name in ("operators", "observers")}
    if unknown := facts.keys() - lists.keys():
        raise KeysError(f"{folder / ACCESS}: unknown key '{min(unknown)}'; it has operators and observers")
    return Access(**lists)


def revoked_vehicles(folder: Path) -> frozenset[str]:
    """The vehicles that the identity in ``folder`` must not talk to, by name; none without a `revoked.toml`."""
    path = folder / REVOKED
    return _names(_toml(path), "vehicles", path) if path.exists() else frozenset()


def write_access(folder: Path, access: Access) -> None:
    """Replaces `access.toml` in one step."""
    _replace(folder / ACCESS, access.toml())


def write_revoked(folder: Path, vehicles: Iterable[str]) -> None:
    """Replaces `revoked.toml` in one step."""
    _replace(folder / REVOKED, revoked_toml(vehicles))


def revoked_toml(vehicles: Iterable[str]) -> str:
    """The text of `revoked.toml`."""
    return f"# Vehicles not to talk to, whoever answers in their name.\nvehicles = {json.dumps(sorted(vehicles))}\n"


def write_identity(folder: Path, pair: Pair, authority_pem: bytes, lists: dict[str, str]) -> None:
    """Makes the folder, or replaces it whole; ``lists`` is the text of access.toml or revoked.toml."""
    contents = {CA: authority_pem, CERT: pair.cert_pem(), KEY: pair.key_pem()}
    contents |= {name: text.encode() for name, text in lists.items()}
    place_folder(folder, contents)


def place_folder(folder: Path, contents: dict[str, bytes]) -> None:
    """Writes the files beside ``folder`` first, so that there is the old one or the new one, never a half."""
    make_private(folder.parent)
    fresh = Path(tempfile.mkdtemp(prefix=".new-", dir=folder.parent))
    try:
        for name, content in contents.items():
            write_private(fresh / name, content)
        old = None
        if folder.exists():
            old = Path(tempfile.mkdtemp(prefix=".old-", dir=folder.parent))
            folder.rename(old / folder.name)
        fresh.rename(folder)
        if old is not None:
            shutil.rmtree(old)
    except BaseException:
        shutil.rmtree(fresh, ignore_errors=True)
        raise


def make_private(folder: Path) -> None:
    """Makes a folder that nobody else may enter."""
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)


def write_private(path: Path, content: bytes) -> None:
    """A new file that nobody else may read, at no instant."""
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(content)


def _replace(path: Path, text: str) -> None:
    fresh = path.with_name(f".{path.name}.new")
    fresh.unlink(missing_ok=True)
    write_private(fresh, text.encode())
    fresh.replace(path)


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise KeysError(f"cannot read {path}: {error.strerror}") from error


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(_bytes(path).decode())
    except (ValueError, UnicodeDecodeError) as error:
        raise KeysError(f"{path}: {error}") from error


def _names(facts: dict[str, Any], key: str, path: Path) -> frozenset[str]:
    listed: Any = facts.get(key)
    names = cast("list[Any]", listed) if isinstance(listed, list) else None
    if names is None or not all(isinstance(name, str) for name in names):
        raise KeysError(f'{path}: {key} is no list of names such as ["alice"]')
    return frozenset(names)
