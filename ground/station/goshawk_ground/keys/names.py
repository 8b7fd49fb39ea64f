"""Who there is: a role and a name, written `operator.alice`; and the one error of these modules."""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from goshawk_proto.keys import ANY_VEHICLE, KEYS, key_expression

LONGEST_NAME = 32
"""A certificate's common name holds 64 characters; a file's and a column's width ask for less."""


class KeysError(RuntimeError):
    """It cannot be done. One line: what is wrong and what to do."""


class BadNameError(KeysError):
    """What was typed is no name."""


class Role(StrEnum):
    """What a holder may do; the vehicle's access lists spell it out."""

    VEHICLE = "vehicle"
    OPERATOR = "operator"
    OBSERVER = "observer"


PEOPLE = (Role.OPERATOR, Role.OBSERVER)


@dataclass(frozen=True, kw_only=True, order=True)
class Holder:
    """Whose an identity is."""

    role: Role
    name: str

    def __str__(self) -> str:
        """The certificate's common name and the folder's: `operator.alice`."""
        return f"{self.role}.{self.name}"


def holder(role: Role, name: str) -> Holder:
    """Raises BadNameError unless ``name`` may stand in a key expression, and is 32 characters at most."""
    try:
        key_expression(next(iter(KEYS)), name)
        good = name != ANY_VEHICLE and len(name) <= LONGEST_NAME
    except ValueError:
        good = False
    if not good:
        raise BadNameError(f"'{name}' is no name: use 1 to {LONGEST_NAME} of a-z, 0-9, '_' and '-'")
    return Holder(role=role, name=name)


def parse_holder(text: str) -> Holder:
    """Reads `operator.alice`; raises BadNameError."""
    role, _, name = text.partition(".")
    if role not in tuple(Role):
        raise BadNameError(f"'{text}' is nobody: write vehicle.NAME, operator.NAME or observer.NAME")
    return holder(Role(role), name)


def default_folder() -> Path:
    """`goshawk/keys` in the user's configuration folder."""
    base = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(base).expanduser() / "goshawk" / "keys"
