"""Identities of everybody who comes to a vehicle: those whom it knows, and strangers of each kind."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from goshawk_ground.keys.authority import Pair, issue, new_authority
from goshawk_ground.keys.identity import Access, write_identity
from goshawk_ground.keys.names import Holder, Role
from goshawk_ground.link import DEFAULT_VEHICLE


@dataclass(frozen=True, kw_only=True)
class People:
    """A folder with one identity each; the vehicle admits operators alice, carol and dave, and observer bob."""

    folder: Path
    authority: Pair

    def of(self, who: str) -> Path:
        return self.folder / who

    def make(self, role: Role, name: str, *, lasts: timedelta, authority: Pair | None = None, folder: str = "") -> Path:
        """Writes an identity that ends ``lasts`` from now."""
        who = Holder(role=role, name=name)
        signer = authority or self.authority
        place = self.of(folder or str(who))
        access = Access(operators=frozenset({"alice", "carol", "dave"}), observers=frozenset({"bob"})).toml()
        files = {"access.toml": access} if role is Role.VEHICLE else {}
        write_identity(place, issue(signer, who, datetime.now(UTC) + lasts), signer.cert_pem(), files)
        return place


def everybody(folder: Path) -> People:
    """The vehicle, its operator and observer, and five strangers."""
    people = People(folder=folder, authority=new_authority())
    day = timedelta(days=1)
    people.make(Role.VEHICLE, DEFAULT_VEHICLE, lasts=day)
    people.make(Role.OPERATOR, "alice", lasts=day)
    people.make(Role.OBSERVER, "bob", lasts=day)
    people.make(Role.OPERATOR, "carol", lasts=-day)  # admitted, but expired
    people.make(Role.OPERATOR, "mallory", lasts=day)  # of this owner, but not admitted: revoked
    people.make(Role.VEHICLE, "other", lasts=day)
    people.make(Role.OPERATOR, "alice", lasts=day, authority=new_authority(), folder="forged.alice")
    # Shows no certificate of its own, which Zenoh allows a client.
    bare = people.of("nobody")
    bare.mkdir()
    (bare / "ca.pem").write_bytes(people.authority.cert_pem())
    return people
