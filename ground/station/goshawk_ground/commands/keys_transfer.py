"""`goshawk keys pair | export | import | config`: brings identities to where they are used."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from goshawk_ground.commands.keys import Days, Keys, Name, Who, holder_or_fail, keys, one_line_errors, open_keyring
from goshawk_ground.commands.options import Json, print_json
from goshawk_ground.keys.names import BadNameError, KeysError, Role

OutFile = Annotated[Path, typer.Option("--file", metavar="OUT.tar", help="A new file; keep it secret.")]


@keys.command(
    epilog="Examples: goshawk keys pair hawk --ssh root@192.168.1.7 | "
    "goshawk keys pair hawk --ssh pi@hawk.local:/home/pi/identity | goshawk keys pair hawk --file hawk.tar"
)
def pair(
    name: Name,
    ssh: Annotated[
        str,
        typer.Option(
            metavar="USER@HOST[:DIR]",
            help="DIR: /etc/goshawk/identity for root, else ~/.config/goshawk/identity. ~/.ssh/config is heeded.",
        ),
    ] = "",
    file: Annotated[
        Path | None, typer.Option(metavar="OUT.tar", help="Instead of ssh: a new file to carry; keep it secret.")
    ] = None,
    days: Days = 365,
    folder: Keys = None,
    as_json: Json = False,
) -> None:
    """Give a vehicle its identity. Makes the keyring, an operator of your name and the vehicle's where missing."""
    from goshawk_ground.keys.pairing import parse_place, prepare, send
    from goshawk_ground.keys.parcel import write_parcel

    who = holder_or_fail(Role.VEHICLE, name)
    with one_line_errors():
        if bool(ssh) == (file is not None):
            raise BadNameError("say where to: --ssh USER@HOST, or --file OUT.tar")
        place = parse_place(ssh) if ssh else None
        ring = open_keyring(folder)
        identity, made = prepare(ring, who, days)
        if place is not None:
            there, host = send(identity, place), place.host
        else:
            assert file is not None
            write_parcel(identity, file)
            there, host = "/etc/goshawk/identity", "HOST"
        ring.mark_paired(who)
    if as_json:
        where = {"file": file} if file is not None else {"host": host, "folder": there}
        print_json({"vehicle": name, **where, "made": [str(each) for each in made]})
        return
    for each in made:
        typer.echo(f"made {each}")
    if file is None:
        typer.echo(f"{who} is paired: {host}:{there}")
    else:
        typer.echo(f"{file}: delete it once the vehicle has it. There, as root:")
        typer.echo(f"  install -d -m 700 {there} && tar -xf {file.name} -C {there} --strip-components=1")
        typer.echo(f"  chown -R goshawk {there}   # or who else runs goshawk-air")
    typer.echo(f'in the vehicle\'s file: name = "{name}", and under [network]:')
    typer.echo('  listen = ["tls/0.0.0.0:7447", "unixsock-stream//run/goshawk/sensors.sock"]  # the ground; sensors')
    typer.echo(f'  identity = "{there}"')
    typer.echo("then restart goshawk-air there, and here:")
    typer.echo(f"  goshawk status --vehicle {name} --connect tls/{host}:7447")


@keys.command(epilog="Example: goshawk keys export operator.bob --file bob.tar")
def export(who: Who, file: OutFile, folder: Keys = None, as_json: Json = False) -> None:
    """Write an identity as a file, to import it on another laptop."""
    from goshawk_ground.keys.parcel import write_parcel

    with one_line_errors():
        ring = open_keyring(folder)
        found = ring.find(who)
        write_parcel(ring.identity(found), file)
    if as_json:
        print_json({"holder": str(found), "file": file})
        return
    typer.echo(
        f"{file}: whoever has it is {found}. On the other laptop: goshawk keys import {file.name}; then delete it"
    )


@keys.command("import", epilog="Examples: goshawk keys import bob.tar | goshawk keys import bob.tar --force")
def import_(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What goshawk keys export wrote.")],
    force: Annotated[bool, typer.Option("--force", help="Replace the one that is here.")] = False,
    folder: Keys = None,
    as_json: Json = False,
) -> None:
    """Check an exported identity and put it into this machine's keyring."""
    from goshawk_ground.keys.parcel import import_parcel

    with one_line_errors():
        made = import_parcel(open_keyring(folder), file, force=force)
    if as_json:
        print_json({"holder": str(made.who), "identity": made.folder})
        return
    typer.echo(f"{made.folder}: valid until {made.cert.not_valid_after_utc:%Y-%m-%d}. Now delete {file}")


@keys.command(
    epilog="Examples: goshawk keys config operator.alice --connect tls/192.168.1.7:7447 > zenoh.json5 | "
    "goshawk keys config vehicle.hawk --listen tls/0.0.0.0:7447"
)
def config(
    who: Who,
    connect: Annotated[str, typer.Option(metavar="ENDPOINT", help="Where a person's client dials.")] = "",
    listen: Annotated[str, typer.Option(metavar="ENDPOINT", help="Where a vehicle listens.")] = "",
    folder: Keys = None,
) -> None:
    """Print a Zenoh configuration (JSON5) with this identity, for any other Zenoh program."""
    from goshawk_ground.keys.zenoh_config import zenoh_config

    with one_line_errors():
        ring = open_keyring(folder)
        found = ring.find(who)
        wanted, endpoint = ("--listen", listen) if found.role is Role.VEHICLE else ("--connect", connect)
        if not endpoint or (connect and listen):
            raise BadNameError(f"for {found} say {wanted} tls/HOST:7447, and nothing else")
        if not endpoint.startswith("tls/"):
            raise KeysError(f"'{endpoint}' has no place for keys; use tls/HOST:PORT")
        text = zenoh_config(ring.identity(found), endpoint)
    typer.echo(text, nl=False)


def register(app: typer.Typer) -> None:
    """Adds `goshawk keys`, all of it, to the `goshawk` command."""
    app.add_typer(keys)
