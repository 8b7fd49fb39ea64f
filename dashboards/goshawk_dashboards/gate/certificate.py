"""The certificate of a dashboard that other machines open: the owner's, or one that is made once and kept."""

from __future__ import annotations

import datetime as dt
import ipaddress
import os
import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

VALID = dt.timedelta(days=397)
RENEWED_BEFORE = dt.timedelta(days=7)


class CertificateError(OSError):
    """A certificate or key cannot be used; one line says why and what to do."""


@dataclass(frozen=True, kw_only=True)
class Tls:
    """What HTTPS needs."""

    context: ssl.SSLContext
    names: frozenset[str]
    """The names that the certificate is for, in lower case."""
    fingerprint: str
    """SHA-256 of the certificate, as browsers show it."""


def load(certificate: Path, key: Path) -> Tls:
    """From two PEM files. Raises CertificateError."""
    try:
        found = x509.load_pem_x509_certificate(certificate.read_bytes())
    except OSError as error:
        raise CertificateError(f"cannot read the certificate {certificate}: {error.strerror}") from error
    except ValueError as error:
        raise CertificateError(f"{certificate} is no certificate in PEM") from error
    if found.not_valid_after_utc < dt.datetime.now(dt.UTC):
        raise CertificateError(f"the certificate {certificate} ended on {found.not_valid_after_utc:%d %B %Y}: renew it")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # A key with a passphrase would be asked for on the terminal: it is refused instead.
        context.load_cert_chain(certificate, key, password=_no_passphrase)
    except ssl.SSLError as error:
        raise CertificateError(f"{key} is not the key of {certificate}, or has a passphrase: {error.reason}") from error
    except OSError as error:
        raise CertificateError(f"cannot read the key {key}: {error.strerror}") from error
    return Tls(context=context, names=frozenset(_names(found)), fingerprint=_fingerprint(found))


def kept_in(folder: Path, names: Sequence[str]) -> Tls:
    """One of our own making, for these names and addresses; made again when it is about to end.

    It stays the same from start to start, so that a browser which accepted it once asks no more.
    """
    certificate, key = folder / "dashboard-certificate.pem", folder / "dashboard-key.pem"
    try:
        if not (key.exists() and _lasts(certificate)):
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            _make(certificate, key, names)
    except OSError as error:
        raise CertificateError(
            f"cannot keep a certificate in {folder}: {error.strerror}; give --certificate"
        ) from error
    return load(certificate, key)


def _lasts(path: Path) -> bool:
    try:
        found = x509.load_pem_x509_certificate(path.read_bytes())
    except (FileNotFoundError, ValueError):
        return False
    return found.not_valid_after_utc - RENEWED_BEFORE > dt.datetime.now(dt.UTC)


def _make(certificate: Path, key: Path, names: Sequence[str]) -> None:
    secret = ec.generate_private_key(ec.SECP256R1())
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "Goshawk dashboard")])
    now = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(secret.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + VALID)
        .add_extension(x509.SubjectAlternativeName([_general(name) for name in names]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .sign(secret, hashes.SHA256())
    )
    pem = secret.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    key.unlink(missing_ok=True)
    with os.fdopen(os.open(key, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        file.write(pem)
    certificate.write_bytes(made.public_bytes(serialization.Encoding.PEM))


def _no_passphrase() -> str:
    return ""


def _general(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _names(certificate: x509.Certificate) -> list[str]:
    try:
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return [name.lower() for name in names.get_values_for_type(x509.DNSName)]


def _fingerprint(certificate: x509.Certificate) -> str:
    return certificate.fingerprint(hashes.SHA256()).hex(":").upper()
