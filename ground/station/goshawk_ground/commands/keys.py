"""`goshawk keys`: makes, lists and revokes identities."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from goshawk_ground.commands.options import NO_REPLY, REFUSED, Json, fail, print_json
from goshawk_ground.keys.names import BadNameError, Holder, KeysError, Role, default_folder, holder

if TYPE_CHECKING:
    from goshawk_ground.keys.keyring import Keyring

EXPIRES_SOON_DAYS = 30

Keys = Annotated[
    Path | None, typer.Option("--keys", metavar="DIR", help="The keyring; default: ~/.config/goshawk/keys.")
]
Days = Annotated[int, typer.Option(min=1, max=3650, help="How long the certificate is valid.")]
Renew = Annotated[bool, typer.Option("--renew", help="A new key and certificate for who is there already.")]
Name = Annotated[str, typer.Argument(metavar="NAME", help="a-z, 0-9, '_' and '-', at most 32.")]
Who = Annotated[
    str, typer.Argument(metavar="ROLE.NAME", help="Such as operator.alice; the name alone where it is clear.")
]
Admitting = Annotated[
    list[str] | None,
    typer.Option("--vehicle", metavar="NAME", help="Admit to this vehicle only; give it again for several."),
]

keys = typer.Typer(
    name="keys",
    help="Who may fly: an authority of your own, and keys for vehicles, operators and observers.",
    epilog="Typical: goshawk keys pair hawk --ssh root@192.168.1.7, which does all that is needed for one vehicle.",
    no_args_is_help=True,
    rich_markup_mode="rich",
)


def open_keyring(folder: Path | None) -> Keyring:
    """The keyring that was named, or the user's own."""
    from goshawk_ground.keys.keyring import Keyring  # cryptography takes a tenth of a second

    return Keyring(folder=folder or default_folder())


@contextmanager
def one_line_errors() -> Generator[None]:
    """Ends with one line where a key cannot be made, read or written."""
    try:
        yield
    except KeysError as error:
        fail(str(error), NO_REPLY if isinstance(error, BadNameError) else REFUSED)
    except OSError as error:
        fail(f"cannot use {error.filename}: {error.strerror}", REFUSED)


@keys.command(epilog="Examples: goshawk keys init | goshawk keys init --keys /media/stick/keys")
def init(folder: Keys = None, as_json: Json = False) -> None:
    """Make a keyring with an authority of your own, valid for ten years."""
    ring = open_keyring(folder)
    with one_line_errors():
        ring.init()
    if as_json:
        print_json({"keyring": ring.folder})
        return
    typer.echo(f"{ring.folder}: a new authority. Keep a copy of this folder where nobody else reads it")
    typer.echo("next: goshawk keys vehicle NAME, goshawk keys operator NAME")


@keys.command(epilog="Examples: goshawk keys vehicle hawk | goshawk keys vehicle hawk --renew")
def vehicle(name: Name, days: Days = 365, renew: Renew = False, folder: Keys = None, as_json: Json = False) -> None:
    """Make a vehicle's identity. It admits every operator and observer of the keyring."""
    from goshawk_ground.keys.authority import in_days

    with one_line_errors():
        ring = open_keyring(folder)
        made = ring.make(holder(Role.VEHICLE, name), in_days(days), renew=renew)
    admitted = [f"operator.{n}" for n in sorted(made.access.operators)]
    admitted += [f"observer.{n}" for n in sorted(made.access.observers)]
    if as_json:
        print_json({"identity": made.folder, "expires": made.cert.not_valid_after_utc.isoformat(), "admits": admitted})
        return
    typer.echo(f"{made.folder}: valid until {made.cert.not_valid_after_utc:%Y-%m-%d}")
    typer.echo(f"it admits {', '.join(admitted) or 'nobody yet: goshawk keys operator NAME'}")
    typer.echo(f"next: goshawk keys pair {name} --ssh USER@HOST")


@keys.command(epilog="Examples: goshawk keys operator alice | goshawk keys operator bob --vehicle hawk")
def operator(
    name: Name,
    days: Days = 365,
    renew: Renew = False,
    vehicles: Admitting = None,
    folder: Keys = None,
    as_json: Json = False,
) -> None:
    """Make the identity of a person who starts, stops and sees. Every vehicle of the keyring then admits it."""
    _person(holder_or_fail(Role.OPERATOR, name), days, renew, vehicles, folder, as_json)


@keys.command(epilog="Examples: goshawk keys observer carol | goshawk keys observer carol --days 7")
def observer(
    name: Name,
    days: Days = 365,
    renew: Renew = False,
    vehicles: Admitting = None,
    folder: Keys = None,
    as_json: Json = False,
) -> None:
    """Make the identity of a person who sees and no more. Every vehicle of the keyring then admits it."""
    _person(holder_or_fail(Role.OBSERVER, name), days, renew, vehicles, folder, as_json)


def holder_or_fail(role: Role, name: str) -> Holder:
    """Whom the words name, or one line."""
    with one_line_errors():
        return holder(role, name)


def _person(
    who: Holder, days: int, renew: bool, vehicles: list[str] | None, folder: Path | None, as_json: bool
) -> None:
    from goshawk_ground.keys.authority import in_days

    with one_line_errors():
        ring = open_keyring(folder)
        if vehicles is None:
            admitting = [] if renew else ring.holders(Role.VEHICLE)
        else:
            admitting = [ring.find(str(holder(Role.VEHICLE, name))) for name in vehicles]
        made = ring.make(who, in_days(days), renew=renew)
        changed = ring.admit(who, admitting)
    if as_json:
        expires = made.cert.not_valid_after_utc.isoformat()
        print_json({"identity": made.folder, "expires": expires, "pair_anew": [v.name for v in changed]})
        return
    typer.echo(f"{made.folder}: valid until {made.cert.not_valid_after_utc:%Y-%m-%d}")
    say_pair_anew(changed, f"before it admits {who}")


def say_pair_anew(vehicles: list[Holder], why: str) -> None:
    """A line for each vehicle that does not know yet."""
    for each in vehicles:
        typer.echo(
            f"{each} must be paired anew {why}: goshawk keys pair {each.name} --ssh USER@HOST; "
            "then start goshawk-air again there"
        )


@keys.command(epilog="Examples: goshawk keys revoke operator.bob | goshawk keys revoke bob")
def revoke(who: Who, folder: Keys = None, as_json: Json = False) -> None:
    """Take somebody out: a person of every access list, a lost vehicle of what operators talk to."""
    with one_line_errors():
        ring = open_keyring(folder)
        ring.authority()
        gone = ring.find(who)
        told = ring.revoke(gone)
    if as_json:
        names = [str(each) for each in told]
        key = "export_anew" if gone.role is Role.VEHICLE else "pair_anew"
        print_json({"revoked": str(gone), key: names})
        return
    typer.echo(f"{gone} is revoked; its folder is now in {ring.folder / 'revoked'}")
    if gone.role is not Role.VEHICLE:
        say_pair_anew(told, f"before it refuses {gone}")
        return
    for each in told:
        typer.echo(f"{each} refuses it from here; for another laptop: goshawk keys export {each} --file {each}.tar")


@keys.command("list", epilog="Examples: goshawk keys list | goshawk keys list --json | jq '.holders[].expires_days'")
def list_(folder: Keys = None, as_json: Json = False) -> None:
    """Who has a key, until when, and who admits whom."""
    with one_line_errors():
        ring = open_keyring(folder)
        rows = [_facts(ring, who) for who in ring.holders()]
        revoked = [str(who) for who in ring.revoked()]
    if as_json:
        print_json({"keyring": ring.folder, "holders": rows, "revoked": revoked})
        return
    if not rows:
        typer.echo(f"{ring.folder} holds no identity yet; next: goshawk keys vehicle NAME, goshawk keys operator NAME")
    else:
        _print_rows(rows)
    if revoked:
        typer.echo(f"revoked: {', '.join(revoked)}")


def _facts(ring: Keyring, who: Holder) -> dict[str, Any]:
    from goshawk_ground.keys.authority import days_left, fingerprint

    made = ring.identity(who)
    facts = {
        "role": who.role,
        "name": who.name,
        "expires": made.cert.not_valid_after_utc.isoformat(),
        "expires_days": round(days_left(made.cert), 1),
        "sha256": fingerprint(made.cert),
    }
    if who.role is Role.VEHICLE:
        lists = {"operators": sorted(made.access.operators), "observers": sorted(made.access.observers)}
        return facts | lists | {"paired": ring.paired(who)}
    return facts | {"admitted_by": [v.name for v in ring.admitting(who)]}


def _print_rows(rows: list[dict[str, Any]]) -> None:
    table = Table("role", "name", "expires", "SHA-256", "admitted by", box=None, pad_edge=False)
    for row in rows:
        days = row["expires_days"]
        expires = f"{days:.0f} days" if days > 0 else "EXPIRED"
        if row["role"] == Role.VEHICLE:
            last = Text("" if row["paired"] else "pair it anew", style="yellow")
        else:
            last = Text(", ".join(row["admitted_by"]) or "no vehicle here", overflow="fold")
        table.add_row(
            row["role"],
            Text(row["name"], overflow="fold"),
            Text(expires, style="red" if days < EXPIRES_SOON_DAYS else "green"),
            row["sha256"][:16],
            last,
        )
    Console(highlight=False).print(table)
