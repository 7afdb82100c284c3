"""One certificate for each program of a run, by an authority of the run's own."""

import datetime
import ipaddress
import os
from collections.abc import Iterable
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from phalanx.wire.certificates import AUTHORITY, CERTIFICATE, PRIVATE_KEY

_CLOCKS_DIFFER = datetime.timedelta(minutes=5)


def make_certificates(
    folder: Path, names: Iterable[str], hosts: Iterable[str], valid: datetime.timedelta
) -> None:
    """Make an authority, and a folder with a certificate and its private key for each name.

    The authority's own key is not kept: nobody can add a name later.

    Args:
        folder: of these folders; new, or empty; only its owner may look into it.
        names: of the programs; each becomes the common name of its certificate.
        hosts: names and addresses under which the hub is reached.
        valid: for how long.

    Raises:
        FileExistsError: there is something in the folder. OSError: it cannot be written.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise FileExistsError(f"{folder}: expected a folder that is new or empty")
    issuer_key = ec.generate_private_key(ec.SECP256R1())
    issuer = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "phalanx run")])
    authority = (
        _begun(issuer, issuer, issuer_key, valid)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .sign(issuer_key, hashes.SHA256())
    )
    alternatives = x509.SubjectAlternativeName([_host(host) for host in hosts])
    usage = x509.ExtendedKeyUsage(
        [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    )
    for name in names:
        own_key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        certificate = (
            _begun(subject, issuer, own_key, valid)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(alternatives, critical=False)
            .add_extension(usage, critical=False)
            .sign(issuer_key, hashes.SHA256())
        )
        secret = own_key.private_bytes(
            serialization.Encoding.PEM,
            serialization.PrivateFormat.PKCS8,
            serialization.NoEncryption(),
        )
        own = folder / name
        own.mkdir(mode=0o700)
        _write(own / AUTHORITY, _pem(authority))
        _write(own / CERTIFICATE, _pem(certificate))
        _write(own / PRIVATE_KEY, secret)


def _begun(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    valid: datetime.timedelta,
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now + min(valid, datetime.timedelta()) - _CLOCKS_DIFFER)
        .not_valid_after(now + valid)
    )


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _write(file: Path, content: bytes) -> None:
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
        out.write(content)
