"""From the options of `goshawk ground` and `goshawk review` to who may open them, and what the operator is told."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from pathlib import Path

import typer
from goshawk_dashboards.gate import Access, PortBusyError, Role, Tls, access, certificate

from goshawk_ground.commands.options import NO_REPLY, fail


@dataclass(frozen=True, kw_only=True)
class Secrets:
    """The files that were named on the command line."""

    certificate: Path | None = None
    key: Path | None = None
    token: Path | None = None
    operator_password: Path | None = None
    observer_password: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Admission:
    """Who may open the dashboard."""

    access: Access
    tls: Tls | None
    made_password: str | None
    """The operator's, where none was given and one is needed; nobody knows it until it is printed."""

    def facts(self) -> dict[str, str]:
        """What a script must know beside the link."""
        known = {"operator_password": self.made_password, "fingerprint": self.tls and self.tls.fingerprint}
        return {name: value for name, value in known.items() if value is not None}

    def words(self, port: int) -> Iterator[str]:
        """What a person must know beside the link, a line each."""
        if self.tls is None:
            return
        yield f"other machines: https://{socket.gethostname()}:{port}/ or this machine's address, then log in"
        if self.made_password is not None:
            yield f"operator's password: {self.made_password}"
        yield f"certificate, SHA-256: {self.tls.fingerprint}"


def admit(host: str, files: Secrets) -> Admission:
    """For a dashboard on ``host``: on this machine the link is enough, for others there is HTTPS and a password.

    Raises OSError with one line about what is wrong and what to do.
    """
    key = access.key_from(files.token) if files.token is not None else None
    alone = _is_this_machine(host)
    passwords = {
        role: access.password_from(path)
        for role, path in ((Role.OPERATOR, files.operator_password), (Role.OBSERVER, files.observer_password))
        if path is not None
    }
    made = None
    if not alone and Role.OPERATOR not in passwords:
        made = passwords[Role.OPERATOR] = access.new_password()
    if len(set(passwords.values())) < len(passwords):
        raise access.SecretError("operator and observer have the same password: give them different ones")
    admitted = Access(passwords=passwords) if key is None else Access(key=key, passwords=passwords)
    return Admission(access=admitted, tls=_tls(host, alone, files), made_password=made)


@contextlib.contextmanager
def failing_in_one_line() -> Generator[None]:
    """What is wrong with a file or an address ends the command with one line."""
    try:
        yield
    except PortBusyError as error:
        fail(f"{error}; choose another with --port", NO_REPLY)
    except OSError as error:
        fail(str(error), NO_REPLY)


def _tls(host: str, alone: bool, files: Secrets) -> Tls | None:
    if (files.certificate is None) != (files.key is None):
        raise certificate.CertificateError("--certificate and --key go together: give both or neither")
    if files.certificate is not None and files.key is not None:
        return certificate.load(files.certificate, files.key)
    return None if alone else certificate.kept_in(Path(typer.get_app_dir("goshawk")), _names(host))


def _is_this_machine(host: str) -> bool:
    with contextlib.suppress(OSError, ValueError):
        place = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0]
        return ipaddress.ip_address(str(place).partition("%")[0]).is_loopback
    return False


def _names(host: str) -> list[str]:
    """By what other machines may call this one."""
    own = socket.gethostname()
    names = {"localhost", "127.0.0.1", "::1", own, f"{own}.local"}
    if host not in ("0.0.0.0", "::"):
        names.add(host)
    with contextlib.suppress(OSError), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.0.2.1", 9))  # sends nothing: it asks which of our addresses would
        names.add(probe.getsockname()[0])
    return sorted(names)
