"""Certificates of a fleet: one authority, and one certificate for each role, by whose common name rights are given.

It needs the extra "tls"; `readygo.apps.fleet.access` and `readygo certs` say so where that is missing.
"""

import datetime
import ipaddress
import re
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from readygo.common.bus.identity import ALL, COORDINATOR, MONITOR, OPERATOR, RECORDER, TRAINER, Identity
from readygo.common.errors import CertificateError
from readygo.common.files import write_then_rename, write_whole
from readygo.common.messages.stages import STAGES

AUTHORITY = "ca"
AUTHORITY_DAYS = 3650
EARLY = datetime.timedelta(hours=1)
"""Certificates are valid from so long before they are made: clocks of hosts differ."""
ROLES = (COORDINATOR, *dict.fromkeys(stage.role for stage in STAGES), ALL, TRAINER, OPERATOR, MONITOR)
"""Names of certificates, besides those of recorders."""
_RECORDER = re.compile(rf"{RECORDER}\.[A-Za-z0-9_]+")


def make_authority(folder: Path) -> None:
    """Make a new authority: `ca.pem` for all hosts, and `ca.key`, which stays where it is.

    Raises:
        CertificateError: If there is one already, or the folder cannot be written.
    """
    if (folder / f"{AUTHORITY}.key").exists():
        raise CertificateError(f"{folder} has an authority already; without it its certificates are worth nothing.")
    key = _new_key()
    name = _subject("readygo fleet")
    constraints = x509.BasicConstraints(ca=True, path_length=0)
    builder = _builder(name, name, key, AUTHORITY_DAYS).add_extension(constraints, critical=True)
    _write(folder, AUTHORITY, key, _sign(builder, key))


def issue(authority: Path, out: Path, name: str, *, hosts: Sequence[str] = (), days: float = 90.0) -> None:
    """Make a certificate and its key.

    Args:
        authority: Folder of the authority.
        out: Where `{name}.pem`, `{name}.key` and the authority's `ca.pem` go.
        name: Common name, one of `ROLES` or "recorder.NAME".
        hosts: Names and addresses under which others reach a router that shows it.
        days: How long it is valid.

    Raises:
        CertificateError: If there is no authority, the name is none, or the folder cannot be written.
    """
    if name not in ROLES and not _RECORDER.fullmatch(name):
        raise CertificateError(f"A certificate is of a role, {', '.join(ROLES)}, or of recorder.NAME, got {name!r}.")
    if not 0.0 < days <= AUTHORITY_DAYS:
        raise CertificateError(f"--days must be more than 0 and at most {AUTHORITY_DAYS}, got {days:g}.")
    signer, signer_key = _certificate(authority / f"{AUTHORITY}.pem"), _key(authority / f"{AUTHORITY}.key")
    key = _new_key()
    usage = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    builder = (
        _builder(_subject(name), signer.subject, key, days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(usage, critical=False)
    )
    if hosts:
        names = x509.SubjectAlternativeName([_host(host) for host in hosts])
        builder = builder.add_extension(names, critical=False)
    _write(out, name, key, _sign(builder, signer_key))
    if out.resolve() != authority.resolve():
        write_whole(out / f"{AUTHORITY}.pem", _pem(signer), raises=CertificateError)


def load_identity(folder: Path, name: str) -> Identity:
    """The certificate of a name, checked before it is used in a connection.

    Args:
        folder: Holds `ca.pem`, `{name}.pem` and `{name}.key`.
        name: Common name.

    Raises:
        CertificateError: If it is missing, expired, of another authority or of another name.
    """
    identity = Identity(
        name=name,
        certificate=folder / f"{name}.pem",
        key=folder / f"{name}.key",
        authority=folder / f"{AUTHORITY}.pem",
    )
    if not identity.certificate.exists():
        found = sorted(path.stem for path in folder.glob("*.pem") if path.stem != AUTHORITY)
        held = f"it has {', '.join(found)}" if found else "it has none"
        raise CertificateError(
            f"{folder} has no certificate of {name} ({held}); `readygo certs issue {name}` makes one where the "
            "authority is."
        )
    certificate, authority = _certificate(identity.certificate), _certificate(identity.authority)
    _check(identity, certificate, authority)
    if _key(identity.key).public_key() != certificate.public_key():
        raise CertificateError(f"{identity.key} is not the key of {identity.certificate}.")
    return identity


def _check(identity: Identity, certificate: x509.Certificate, authority: x509.Certificate) -> None:
    path = identity.certificate
    try:
        certificate.verify_directly_issued_by(authority)
    except (InvalidSignature, ValueError, TypeError) as error:
        raise CertificateError(f"{path} is not signed by the authority of {identity.authority}.") from error
    if (named := certificate.subject.rfc4514_string().removeprefix("CN=")) != identity.name:
        raise CertificateError(f"{path} is a certificate of {named}, not of {identity.name}.")
    now = datetime.datetime.now(datetime.UTC)
    for each, name in ((certificate, path), (authority, identity.authority)):
        begin, end = each.not_valid_before_utc, each.not_valid_after_utc
        if now > end:
            raise CertificateError(f"{name} expired at {end:%Y-%m-%d %H:%M} UTC; `readygo certs issue` renews it.")
        if now < begin:
            raise CertificateError(f"{name} is valid from {begin:%Y-%m-%d %H:%M} UTC on; is the clock right?")


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, days: float
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLY)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _sign(builder: x509.CertificateBuilder, key: ec.EllipticCurvePrivateKey) -> x509.Certificate:
    return builder.sign(key, hashes.SHA256())


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _new_key() -> ec.EllipticCurvePrivateKey:
    return ec.generate_private_key(ec.SECP256R1())


def _write(folder: Path, name: str, key: ec.EllipticCurvePrivateKey, certificate: x509.Certificate) -> None:
    """Write a certificate and its key; only the owner can read the key."""
    encoding, pkcs8, bare = serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    path = folder / f"{name}.key"
    with write_then_rename(path, raises=CertificateError) as part:
        part.touch(mode=0o600)
        part.write_bytes(key.private_bytes(encoding, pkcs8, bare))
    write_whole(folder / f"{name}.pem", _pem(certificate), raises=CertificateError)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _certificate(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except OSError as error:
        raise CertificateError(f"{path} cannot be read: {error.strerror}.") from error
    except ValueError as error:
        raise CertificateError(f"{path} is no certificate (PEM).") from error


def _key(path: Path) -> ec.EllipticCurvePrivateKey:
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except OSError as error:
        raise CertificateError(f"{path} cannot be read: {error.strerror}.") from error
    except (ValueError, TypeError) as error:
        raise CertificateError(f"{path} is no private key (PEM, without a password).") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise CertificateError(f"{path} is no key of an elliptic curve.")
    return key
