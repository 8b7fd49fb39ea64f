"""Brings a vehicle its identity over ssh, and makes whatever is missing for that."""

from __future__ import annotations

import getpass
import re
import shlex
import subprocess
from dataclasses import dataclass

from goshawk_ground.keys.authority import days_left, in_days
from goshawk_ground.keys.identity import Identity
from goshawk_ground.keys.keyring import CA_KEY, Keyring
from goshawk_ground.keys.names import LONGEST_NAME, BadNameError, Holder, KeysError, Role
from goshawk_ground.keys.parcel import pack

_PLACE = re.compile(r"(?P<user>[\w.-]+@)?(?P<host>\[[0-9a-fA-F:.%\w]+\]|[\w.-]+)(?::(?P<folder>.+))?")

# The new folder is whole before it takes the old one's place, so a line that breaks leaves the old one. What holds
# anything else than an identity is left alone. The service's user, where there is one, must be able to read the key.
SCRIPT = r"""
set -e
dir=$1
if [ -z "$dir" ]; then
  if [ "$(id -u)" = 0 ]; then dir=/etc/goshawk/identity
  else dir=${XDG_CONFIG_HOME:-$HOME/.config}/goshawk/identity; fi
fi
if [ -e "$dir" ]; then
  for file in $(ls -A "$dir"); do
    case $file in
      ca.pem|cert.pem|key.pem|access.toml) ;;
      *) echo "$dir holds $file: name a folder for the identity alone" >&2; exit 1 ;;
    esac
  done
fi
mkdir -p "$(dirname "$dir")"
umask 077
new=$dir.new.$$
old=$dir.old.$$
trap 'rm -rf "$new"' EXIT
mkdir "$new"
tar -x -f - -C "$new" --strip-components=1
for file in ca.pem cert.pem key.pem access.toml; do test -s "$new/$file"; done
if [ "$(id -u)" = 0 ] && id -u goshawk >/dev/null 2>&1; then chown -R goshawk "$new"; fi
if [ -e "$dir" ]; then mv "$dir" "$old"; fi
mv "$new" "$dir"
rm -rf "$old"
cd "$dir" && pwd
"""


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where a vehicle keeps its identity."""

    login: str
    """What ssh is told: a host, with or without a user."""
    host: str
    folder: str
    """Empty: /etc/goshawk/identity for root, ~/.config/goshawk/identity for anybody else."""


def parse_place(text: str) -> Place:
    """Reads USER@HOST[:DIR]; raises BadNameError."""
    found = _PLACE.fullmatch(text)
    if found is None or text.startswith("-") or found["host"].startswith("-"):
        raise BadNameError(f"'{text}' is no place such as pi@192.168.1.7 or pi@192.168.1.7:/etc/goshawk/identity")
    bare = found["host"].strip("[]")
    folder = (found["folder"] or "").removeprefix("~/").rstrip("/")
    return Place(login=(found["user"] or "") + bare, host=found["host"], folder=folder)


def prepare(ring: Keyring, vehicle: Holder, days: int) -> tuple[Identity, list[Holder]]:
    """The vehicle's identity, and whom it took to make: keyring, an operator of the user's name, the vehicle."""
    made: list[Holder] = []
    if not (ring.folder / CA_KEY).exists() and not (ring.folder.is_dir() and ring.holders()):
        ring.init()
    if vehicle not in ring.holders():
        if not ring.holders(Role.OPERATOR):
            me = Holder(role=Role.OPERATOR, name=login_name())
            ring.make(me, in_days(days))
            ring.admit(me, ring.holders(Role.VEHICLE))
            made.append(me)
        ring.make(vehicle, in_days(days))
        made.append(vehicle)
    identity = ring.identity(vehicle)
    if days_left(identity.cert) <= 0:
        raise KeysError(f"{vehicle} has expired; first: goshawk keys vehicle {vehicle.name} --renew")
    return identity, made


def send(identity: Identity, place: Place) -> str:
    """Copies the folder over ssh; returns where it is now. Raises KeysError, and then the old one is untouched."""
    script = f"sh -c {shlex.quote(SCRIPT)} sh {shlex.quote(place.folder)}"
    try:
        done = subprocess.run(
            ["ssh", "--", place.login, script], input=pack(identity), capture_output=True, check=False
        )
    except FileNotFoundError as error:
        raise KeysError("there is no ssh here; install it, or carry a file: --file OUT.tar") from error
    if done.returncode != 0:
        words = done.stderr.decode(errors="replace").strip().splitlines()
        said = words[-1] if words else f"exit status {done.returncode}"
        raise KeysError(f"{place.login} was not paired: {said}")
    told = done.stdout.decode(errors="replace").strip().splitlines()
    if not told:
        raise KeysError(f"{place.login} was not paired: it ran nothing of what it was asked to")
    return told[-1]


def login_name() -> str:
    """The user's login name, as far as it may be one here."""
    return re.sub(r"[^a-z0-9_-]", "", getpass.getuser().lower())[:LONGEST_NAME] or "operator"
