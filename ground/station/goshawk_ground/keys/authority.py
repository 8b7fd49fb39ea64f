"""The owner's certificate authority: what it signs, and what it takes for its own.

Keys are ECDSA P-256. Certificates are X.509 v3 (RFC 5280) with no extension that rustls does not know. A vehicle's is
for TLS servers only and a person's for clients only, so that nobody's can stand in for a vehicle.
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from goshawk_ground.keys.names import Holder, KeysError, Role, parse_holder

BEGINS = datetime(2020, 1, 1, tzinfo=UTC)
"""Every certificate is valid from here on. A vehicle without a battery for its clock starts in the past, where a
certificate of today is not valid yet and its own operator would be refused. What makes a key good is that this
authority signed it, not when; systemd starts no clock before this date."""

AUTHORITY_YEARS = 10


@dataclass(frozen=True, kw_only=True)
class Pair:
    """A certificate and the key that belongs to it."""

    cert: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    def cert_pem(self) -> bytes:
        """The certificate as text."""
        return self.cert.public_bytes(serialization.Encoding.PEM)

    def key_pem(self) -> bytes:
        """The key as text: PKCS#8, not encrypted, since a vehicle starts with nobody there to type."""
        return self.key.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )


def new_authority(until: datetime | None = None) -> Pair:
    """A new authority, valid ``until`` then, or for ten years."""
    end = until or datetime.now(UTC) + timedelta(days=round(365.25 * AUTHORITY_YEARS))
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(f"goshawk keys {secrets.token_hex(4)}")
    usage = _usage(digital_signature=False, signs_others=True)
    cert = (
        _begun(name, name, key, end)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .sign(key, hashes.SHA256())
    )
    return Pair(cert=cert, key=key)


def issue(authority: Pair, who: Holder, until: datetime) -> Pair:
    """A new key and its certificate, valid ``until`` then and never longer than the authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    purpose = ExtendedKeyUsageOID.SERVER_AUTH if who.role is Role.VEHICLE else ExtendedKeyUsageOID.CLIENT_AUTH
    end = min(until, authority.cert.not_valid_after_utc)
    signer = authority.cert.extensions.get_extension_for_class(x509.SubjectKeyIdentifier).value
    cert = (
        _begun(_name(str(who)), authority.cert.subject, key, end)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(digital_signature=True, signs_others=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(str(who))]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_subject_key_identifier(signer), critical=False)
        .sign(authority.key, hashes.SHA256())
    )
    return Pair(cert=cert, key=key)


def in_days(days: int) -> datetime:
    """The instant so many days from now."""
    return datetime.now(UTC) + timedelta(days=days)


def read_cert(pem: bytes, where: str) -> x509.Certificate:
    """A certificate's text; raises KeysError that names ``where``."""
    try:
        return x509.load_pem_x509_certificate(pem)
    except ValueError as error:
        raise KeysError(f"{where} holds no certificate") from error


def read_key(pem: bytes, where: str) -> ec.EllipticCurvePrivateKey:
    """A private key's text; raises KeysError that names ``where``."""
    try:
        key = serialization.load_pem_private_key(pem, password=None)
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise KeysError(f"{where} holds no private key without a passphrase") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise KeysError(f"{where} holds another kind of key than ECDSA")
    return key


def check_pair(pair: Pair, where: str) -> None:
    """Raises KeysError unless the key is the certificate's."""
    if pair.key.public_key() != pair.cert.public_key():
        raise KeysError(f"{where}: the key does not belong to the certificate")


def check_signed(cert: x509.Certificate, authority: x509.Certificate, where: str) -> None:
    """Raises KeysError unless ``authority`` is one and signed ``cert``."""
    try:
        constraints = authority.extensions.get_extension_for_class(x509.BasicConstraints).value
        cert.verify_directly_issued_by(authority)
    except (x509.ExtensionNotFound, InvalidSignature, UnsupportedAlgorithm, ValueError, TypeError) as error:
        raise KeysError(f"{where}: the certificate was not signed by the authority beside it") from error
    if not constraints.ca:
        raise KeysError(f"{where}: ca.pem is no authority")


def holder_of(cert: x509.Certificate, where: str) -> Holder:
    """Whom a certificate names and is fit for; raises KeysError."""
    names = cert.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    who = parse_holder(str(names[0].value) if len(names) == 1 else "")
    wanted = ExtendedKeyUsageOID.SERVER_AUTH if who.role is Role.VEHICLE else ExtendedKeyUsageOID.CLIENT_AUTH
    try:
        usage = list(cert.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    except x509.ExtensionNotFound:
        usage = []
    if usage != [wanted]:
        raise KeysError(f"{where}: the certificate is not that of a {who.role}")
    return who


def fingerprint(cert: x509.Certificate) -> str:
    """SHA-256 of the certificate, 64 hexadecimal digits."""
    return cert.fingerprint(hashes.SHA256()).hex()


def days_left(cert: x509.Certificate) -> float:
    """Until it expires; negative once it has."""
    return (cert.not_valid_after_utc - datetime.now(UTC)).total_seconds() / 86400


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _begun(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, end: datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(BEGINS)
        .not_valid_after(end)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _usage(*, digital_signature: bool, signs_others: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=digital_signature,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_others,
        crl_sign=signs_others,
        encipher_only=False,
        decipher_only=False,
    )
