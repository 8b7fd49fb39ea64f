"""Identities that nobody has to name: the operator's own on this machine, and those of a demo."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

from goshawk_ground.keys.authority import issue, new_authority
from goshawk_ground.keys.identity import ACCESS, REVOKED, Access, revoked_toml, write_identity
from goshawk_ground.keys.keyring import Keyring
from goshawk_ground.keys.names import Holder, KeysError, Role, default_folder

DEMO_LIFE = timedelta(days=1)


def default_identity() -> Path | None:
    """The folder that the ground uses without `--identity`: the only operator in the user's keyring.

    Without an operator, the only observer. None where there is neither. Raises KeysError where there are several.
    """
    keyring = Keyring(folder=default_folder())
    if not keyring.folder.is_dir():
        return None
    for role in (Role.OPERATOR, Role.OBSERVER):
        people = keyring.holders(role)
        if len(people) > 1:
            first = keyring.path(people[0])
            raise KeysError(f"{keyring.folder} holds {len(people)} {role}s: say which, as in --identity {first}")
        if people:
            return keyring.path(people[0])
    return None


def demo_identities(folder: Path, *, vehicle: str = "goshawk", operator: str = "demo") -> tuple[Path, Path]:
    """Makes a vehicle's and an operator's identity under ``folder``, good for a day; returns their folders.

    Their authority's key is never written down, and the user's keyring is not touched.
    """
    until = datetime.now(UTC) + DEMO_LIFE
    authority = new_authority(until)
    pem = authority.cert_pem()
    flown, flier = Holder(role=Role.VEHICLE, name=vehicle), Holder(role=Role.OPERATOR, name=operator)
    access = Access(operators=frozenset({operator})).toml()
    for who, lists in ((flown, {ACCESS: access}), (flier, {REVOKED: revoked_toml(())})):
        write_identity(folder / str(who), issue(authority, who, until), pem, lists)
    return folder / str(flown), folder / str(flier)
