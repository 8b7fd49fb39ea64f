"""An identity as a tar file, to carry it to another machine."""

from __future__ import annotations

import io
import tarfile
import tempfile
from pathlib import Path

from goshawk_ground.keys.authority import read_cert
from goshawk_ground.keys.identity import (
    ACCESS,
    CA,
    CERT,
    FILES,
    KEY,
    Identity,
    make_private,
    place_folder,
    read_identity,
    write_private,
)
from goshawk_ground.keys.keyring import REVOKED_FOLDER, Keyring
from goshawk_ground.keys.names import BadNameError, Holder, KeysError, Role, parse_holder

LARGEST_FILE = 64 * 1024


def pack(identity: Identity) -> bytes:
    """A tar file with one folder, named after its holder."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w", format=tarfile.USTAR_FORMAT) as tar:
        for name in FILES:
            path = identity.folder / name
            if path.exists():
                content = path.read_bytes()
                entry = tarfile.TarInfo(f"{identity.who}/{name}")
                entry.size, entry.mode = len(content), 0o600
                tar.addfile(entry, io.BytesIO(content))
    return buffer.getvalue()


def write_parcel(identity: Identity, path: Path) -> None:
    """Writes a new tar file that nobody else may read; raises KeysError where there is one."""
    try:
        write_private(path, pack(identity))
    except FileExistsError as error:
        raise KeysError(f"{path} is there already; name a new file") from error


def unpack(path: Path) -> tuple[Holder, dict[str, bytes]]:
    """Reads a tar file without writing anything: whose it is, and its files. Raises KeysError for all that is odd."""
    owners: set[str] = set()
    contents: dict[str, bytes] = {}
    try:
        with tarfile.open(path, mode="r:") as tar:
            for entry in tar:
                owner, _, name = entry.name.partition("/")
                file = tar.extractfile(entry) if entry.isreg() and entry.size <= LARGEST_FILE else None
                if file is None or name not in FILES or name in contents:
                    raise KeysError(f"{path}: '{entry.name}' does not belong in an identity")
                owners.add(owner)
                contents[name] = file.read()
    except (tarfile.TarError, EOFError) as error:
        raise KeysError(f"{path} is no tar file that goshawk keys export wrote") from error
    if len(owners) != 1:
        raise KeysError(f"{path} holds {len(owners)} identities instead of one")
    try:
        who = parse_holder(owners.pop())
    except BadNameError as error:
        raise KeysError(f"{path}: {error}") from error
    needed = {CA, CERT, KEY, ACCESS} if who.role is Role.VEHICLE else {CA, CERT, KEY}
    if missing := needed - contents.keys():
        raise KeysError(f"{path} has no {min(missing)}")
    return who, contents


def import_parcel(ring: Keyring, path: Path, *, force: bool) -> Identity:
    """Checks a tar file and puts it into the keyring; raises KeysError."""
    who, contents = unpack(path)
    make_private(ring.folder)
    with tempfile.TemporaryDirectory(prefix=".import-", dir=ring.folder) as scratch:
        tried = Path(scratch) / str(who)
        place_folder(tried, contents)
        try:
            found = read_identity(tried)
        except KeysError as error:
            raise KeysError(f"{path}: {str(error).replace(f'{tried}/', '').replace(f'{tried}: ', '')}") from error
    if found.who != who:
        raise KeysError(f"{path}: the certificate is {found.who}'s, not {who}'s")
    own = ring.folder / CA
    if own.exists() and read_cert(own.read_bytes(), str(own)) != found.authority:
        raise KeysError(f"{path} is of another authority than {ring.folder}; keep it apart with --keys DIR")
    if (ring.folder / REVOKED_FOLDER / str(who)).exists():
        raise KeysError(f"{who} was revoked here")
    if ring.path(who).exists() and not force:
        raise KeysError(f"{ring.path(who)} is there already; replace it with --force")
    place_folder(ring.path(who), contents)
    return ring.identity(who)
