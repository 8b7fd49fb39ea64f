"""The owner's keyring: the authority, a folder for each holder, and `revoked/` for those who were.

A keyring without `ca-key.pem` holds identities that were brought here; it makes none.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from goshawk_ground.keys.authority import Pair, check_pair, issue, new_authority, read_cert, read_key
from goshawk_ground.keys.identity import (
    ACCESS,
    CA,
    CERT,
    REVOKED,
    Access,
    Identity,
    make_private,
    read_access,
    read_identity,
    revoked_toml,
    write_access,
    write_identity,
    write_private,
    write_revoked,
)
from goshawk_ground.keys.names import BadNameError, Holder, KeysError, Role, parse_holder

CA_KEY = "ca-key.pem"
REVOKED_FOLDER = "revoked"
PAIRED = "paired.json"


@dataclass(frozen=True, kw_only=True)
class Keyring:
    """A keyring's folder; nothing is read before it is asked for."""

    folder: Path

    def init(self) -> None:
        """Makes the authority; raises KeysError where there is one, or somebody else's identities."""
        for taken in (CA, CA_KEY):
            if (self.folder / taken).exists():
                raise KeysError(f"{self.folder} has an authority already ({taken}); another goes elsewhere: --keys DIR")
        if self.folder.is_dir() and (there := self.holders()):
            raise KeysError(f"{self.folder} holds {there[0]} of another authority; begin a new one with --keys DIR")
        make_private(self.folder)
        self.folder.chmod(0o700)
        authority = new_authority()
        write_private(self.folder / CA_KEY, authority.key_pem())
        write_private(self.folder / CA, authority.cert_pem())

    def authority(self) -> Pair:
        """The authority with its key; raises KeysError where it is not, and says what to do."""
        if not (self.folder / CA_KEY).exists():
            if self.folder.is_dir() and self.holders():
                raise KeysError(f"{self.folder} has no {CA_KEY}: new keys are made on the machine that has it")
            raise KeysError(f"there is no keyring in {self.folder}; make one with: goshawk keys init")
        key, cert = self.folder / CA_KEY, self.folder / CA
        try:
            pair = Pair(cert=read_cert(cert.read_bytes(), str(cert)), key=read_key(key.read_bytes(), str(key)))
        except OSError as error:
            raise KeysError(f"cannot read {error.filename}: {error.strerror}") from error
        check_pair(pair, str(self.folder))
        return pair

    def path(self, who: Holder) -> Path:
        """Where this holder's folder is, or would be."""
        return self.folder / str(who)

    def holders(self, *roles: Role) -> list[Holder]:
        """Everybody with a folder here, or those of some roles, in order; raises KeysError without a keyring."""
        return _holders(self._there(), *roles)

    def revoked(self, *roles: Role) -> list[Holder]:
        """Everybody who was revoked."""
        return _holders(self._there() / REVOKED_FOLDER, *roles)

    def identity(self, who: Holder) -> Identity:
        """Reads a holder's folder; raises KeysError, also where there is none."""
        if not self.path(who).is_dir():
            raise KeysError(f"there is no {who} in {self.folder}; goshawk keys list shows who is")
        return read_identity(self.path(who))

    def find(self, text: str) -> Holder:
        """Whom `operator.alice` names, or `alice` where one alone is called so; raises KeysError."""
        here = self.holders()
        if "." in text:
            who = parse_holder(text)
            found = [who] if who in here else []
        else:
            found = [who for who in here if who.name == text]
        if not found:
            gone = [str(who) for who in self.revoked() if text in (str(who), who.name)]
            raise KeysError(
                f"{gone[0]} was revoked already"
                if gone
                else f"there is no {text} in {self.folder}; goshawk keys list shows who is"
            )
        if len(found) > 1:
            raise BadNameError(f"'{text}' is {' and '.join(map(str, found))}: say which")
        return found[0]

    def make(self, who: Holder, until: datetime, *, renew: bool = False) -> Identity:
        """Makes a holder's folder, or its certificate and key anew; who is admitted stays as it is.

        A new vehicle admits everybody here. Raises KeysError, also for a name that was revoked: access lists know
        names, so whoever has the old key would be admitted again.
        """
        authority = self.authority()
        folder = self.path(who)
        if who in self.revoked():
            raise KeysError(f"{who} was revoked, and its old key would be good again: take another name")
        if folder.exists() and not renew:
            raise KeysError(f"{who} is there already; a new certificate for it: --renew")
        if renew and not folder.exists():
            raise KeysError(f"there is no {who} to renew; leave --renew out to make it")
        if who.role is Role.VEHICLE:
            lists = {ACCESS: (read_access(folder) if renew else self._everybody()).toml()}
        else:
            lists = {REVOKED: revoked_toml(gone.name for gone in self.revoked(Role.VEHICLE))}
        write_identity(folder, issue(authority, who, until), authority.cert_pem(), lists)
        return self.identity(who)

    def admit(self, who: Holder, vehicles: list[Holder]) -> list[Holder]:
        """Puts a person on the access lists of ``vehicles``; returns those that changed."""
        changed: list[Holder] = []
        for vehicle in vehicles:
            access = read_access(self.path(vehicle))
            if not access.admits(who):
                write_access(self.path(vehicle), access.plus(who))
                changed.append(vehicle)
        return changed

    def revoke(self, who: Holder) -> list[Holder]:
        """Takes a holder out. Returns whom to bring this to: vehicles to pair anew, or people who must know of it."""
        self.authority()
        told: list[Holder] = []
        if who.role is Role.VEHICLE:
            lost = {gone.name for gone in self.revoked(Role.VEHICLE)} | {who.name}
            for person in self.holders(Role.OPERATOR, Role.OBSERVER):
                write_revoked(self.path(person), lost)
                told.append(person)
        else:
            for vehicle in self.holders(Role.VEHICLE):
                access = read_access(self.path(vehicle))
                if access.admits(who):
                    write_access(self.path(vehicle), access.minus(who))
                    told.append(vehicle)
        make_private(self.folder / REVOKED_FOLDER)
        self.path(who).rename(self.folder / REVOKED_FOLDER / str(who))
        return told

    def admitting(self, who: Holder) -> list[Holder]:
        """The vehicles whose access list here names this person."""
        return [v for v in self.holders(Role.VEHICLE) if read_access(self.path(v)).admits(who)]

    def mark_paired(self, vehicle: Holder) -> None:
        """Remembers that the vehicle was given its folder as it is now."""
        marks = self._marks() | {vehicle.name: self._state(vehicle)}
        path = self.folder / PAIRED
        fresh = path.with_name(f".{PAIRED}.new")
        fresh.unlink(missing_ok=True)
        write_private(fresh, json.dumps(marks, indent=1).encode())
        fresh.replace(path)

    def paired(self, vehicle: Holder) -> bool:
        """Whether the vehicle was last given its folder as it is now."""
        return self._marks().get(vehicle.name) == self._state(vehicle)

    def _marks(self) -> dict[str, str]:
        path = self.folder / PAIRED
        try:
            return json.loads(path.read_text()) if path.exists() else {}
        except ValueError as error:
            raise KeysError(f"{path} is damaged; delete it and pair each vehicle again") from error

    def _state(self, vehicle: Holder) -> str:
        files = b"".join((self.path(vehicle) / name).read_bytes() for name in (CA, CERT, ACCESS))
        return hashlib.sha256(files).hexdigest()

    def _everybody(self) -> Access:
        return Access(
            operators=frozenset(who.name for who in self.holders(Role.OPERATOR)),
            observers=frozenset(who.name for who in self.holders(Role.OBSERVER)),
        )

    def _there(self) -> Path:
        if not self.folder.is_dir():
            raise KeysError(f"there is no keyring in {self.folder}; make one with: goshawk keys init")
        return self.folder


def _holders(folder: Path, *roles: Role) -> list[Holder]:
    found: list[Holder] = []
    for path in folder.iterdir() if folder.is_dir() else ():
        try:
            who = parse_holder(path.name)
        except BadNameError:
            continue
        if path.is_dir() and (not roles or who.role in roles):
            found.append(who)
    return sorted(found)
