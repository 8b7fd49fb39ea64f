"""What the commands share: options, exit statuses, and how they end with an error."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
from pathlib import Path
from typing import Annotated, Any, NoReturn, cast

import typer
from goshawk_dashboards.log.flight import Flight, LogError, header_of
from goshawk_dashboards.log.progress import Progress, unheard

REFUSED = 1
NO_REPLY = 2

Vehicle = Annotated[str, typer.Option(help="The vehicle's name, as in its vehicle file.")]
Connect = Annotated[str, typer.Option(help="A Zenoh endpoint that the vehicle listens on.")]
Identity = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR", help="Folder of who you are (`goshawk keys`), for tls; absent: the operator's in your keyring."
    ),
]


def readable(text: str) -> str:
    """Refuses what no message can hold: bytes of the command line that are not UTF-8."""
    if not text.isprintable():
        raise typer.BadParameter(f"'{visible(text)}' is not plain text")
    return text


A_DAY_S = 86_400.0
Timeout = Annotated[float, typer.Option(min=0.1, max=A_DAY_S, help="Seconds to wait for an answer.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object instead of words.")]
Port = Annotated[int, typer.Option(min=1, max=65535, help="The dashboard's port.")]
Host = Annotated[
    str, typer.Option(help="Address to serve on; 0.0.0.0 for other machines too, by HTTPS and with a login.")
]
TokenFile = Annotated[
    Path | None, typer.Option(help="Keeps links and logins over restarts; made if it does not exist.")
]
CertificateFile = Annotated[
    Path | None, typer.Option(help="A certificate in PEM; absent: one of our own, for other machines.")
]
KeyFile = Annotated[Path | None, typer.Option(help="The certificate's key in PEM, without a passphrase.")]
OperatorPassword = Annotated[
    Path | None, typer.Option(help="File with the operator's password; absent: made and printed, if one is needed.")
]
ObserverPassword = Annotated[
    Path | None, typer.Option(help="File with the password of who may see the flight and command nothing.")
]
BinDir = Annotated[
    Path | None,
    typer.Option(help="Where goshawk-air and goshawk-sim are; absent: a checkout's target/release, else on the PATH."),
]


def fail(text: str, code: int) -> NoReturn:
    """Ends with one clear line on stderr."""
    typer.echo(f"goshawk: {text}", err=True)
    raise typer.Exit(code)


def visible(text: str) -> str:
    """What a terminal would obey, or could not write, as an escape: files and logs may hold it."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def say(line: str) -> None:
    """Prints a line that quotes a file's name or a log."""
    typer.echo(visible(line))


def newest(path: Path) -> Path:
    """Of a folder the newest log in it, else the path as it is, for an argument that is one log."""
    if not path.is_dir():
        return path
    found: list[tuple[int, Path]] = []
    for log in path.rglob("*.mcap"):
        with contextlib.suppress(OSError):  # a link that leads nowhere
            found.append((log.stat().st_mtime_ns, log))
    newest_first = [log for _, log in sorted(found, reverse=True)]
    # Exports end in .mcap too. What has no header may still be a damaged log; the last resort says what is wrong.
    choices = itertools.chain(
        (log for log in newest_first if header_of(log) is not None), filter(_opens, newest_first), newest_first
    )
    return next(choices, None) or fail(f"{path}: no flight logs (.mcap) in this folder", NO_REPLY)


def _opens(log: Path) -> bool:
    try:
        Flight.open(log).log.close()
    except LogError:
        return False
    return True


def newest_of_each(paths: list[Path]) -> list[Path]:
    """Likewise, for an argument that is several."""
    return [newest(path) for path in paths]


LogFile = Annotated[
    Path,
    typer.Argument(
        metavar="LOG",
        help="A flight log (.mcap), complete, cut off or damaged; of a folder the newest.",
        callback=newest,
    ),
]


def print_json(facts: Any) -> None:
    """One JSON object; paths become text, and numbers that are none become null."""
    typer.echo(json.dumps(_told(facts), default=str, allow_nan=False))


def _told(facts: Any) -> Any:
    if isinstance(facts, dict):
        return {name: _told(value) for name, value in cast(dict[Any, Any], facts).items()}
    if isinstance(facts, list | tuple):
        return [_told(value) for value in cast(list[Any], facts)]
    return None if isinstance(facts, float) and not math.isfinite(facts) else facts


def open_flight(path: Path, progress: Progress = unheard) -> Flight:
    """The flight, or one line about why it cannot be read and status 2."""
    try:
        return Flight.open(path, progress=progress)
    except LogError as error:
        fail(visible(str(error)), NO_REPLY)
