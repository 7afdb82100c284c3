"""TLS identities of a run's programs, signed by an authority of the run's own.

An identity is an X.509 certificate of a program's name, and its private key.
"""

import datetime
import ipaddress
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Self

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from phalanx.messages.credentials import AUTHORITY, CERTIFICATE, PRIVATE_KEY
from phalanx.messages.keys import HUBS

_CLOCKS_DIFFER = datetime.timedelta(minutes=5)


class Authority:
    """Signs the identities of a run's programs."""

    def __init__(self, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
        self._certificate, self.key = certificate, key

    @classmethod
    def new(cls, valid: datetime.timedelta) -> Self:
        """Make an authority; the identities that it signs expire with it."""
        key = new_key()
        name = _common_name("phalanx run")
        now = datetime.datetime.now(datetime.UTC)
        certificate = (
            _builder(name, name, key.public_key())
            .not_valid_before(now + min(valid, datetime.timedelta()) - _CLOCKS_DIFFER)
            .not_valid_after(now + valid)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_certificates=True), critical=True)
            .sign(key, hashes.SHA256())
        )
        return cls(certificate, key)

    @property
    def certificate(self) -> bytes:
        """Its own, PEM."""
        return self._certificate.public_bytes(serialization.Encoding.PEM)

    def sign(self, name: str, key: ec.EllipticCurvePublicKey, hosts: Iterable[str] = ()) -> bytes:
        """Sign a name and a public key; return an X.509 certificate, PEM.

        hosts: names and addresses of a hub; without them the identity cannot be used by a hub.
        """
        issuer = self._certificate
        builder = (
            _builder(_common_name(name), issuer.subject, key)
            .not_valid_before(issuer.not_valid_before_utc)
            .not_valid_after(issuer.not_valid_after_utc)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
        )
        usage = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if names := [_host(host) for host in hosts]:
            usage.append(ExtendedKeyUsageOID.SERVER_AUTH)
            alternatives = x509.SubjectAlternativeName(names)
            builder = builder.add_extension(alternatives, critical=False)
        builder = builder.add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        signed = builder.sign(self.key, hashes.SHA256())
        return signed.public_bytes(serialization.Encoding.PEM)


def make_identities(
    folder: Path,
    names: Iterable[str],
    hosts: Iterable[str],
    valid: datetime.timedelta,
) -> Authority:
    """Make an authority, and a folder with the identity of each name; return the authority.

    Args:
        folder: parent of these folders; new or empty; its owner alone can read it.
        names: of the programs, the common names of their identities.
        hosts: names and addresses of the hub.
        valid: time until they expire.

    The authority's key is written nowhere: no identity can be added later.

    Raises:
        FileExistsError: the folder is not empty. OSError: it cannot be written.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise FileExistsError(f"{folder}: expected a folder that is new or empty")
    authority, hub_hosts = Authority.new(valid), tuple(hosts)
    for name in names:
        (identity := folder / name).mkdir(mode=0o700)
        key = new_key()
        write_identity(
            identity,
            authority.certificate,
            authority.sign(name, key.public_key(), hub_hosts if name in HUBS else ()),
            private_pem(key),
        )
    return authority


def write_identity(folder: Path, authority: bytes, certificate: bytes, key: bytes) -> None:
    """Write the three files of an identity, PEM, readable by their owner alone. Raises OSError."""
    _write(folder / AUTHORITY, authority)
    _write(folder / CERTIFICATE, certificate)
    _write(folder / PRIVATE_KEY, key)


def new_key() -> ec.EllipticCurvePrivateKey:
    """Make a private key on the curve P-256."""
    return ec.generate_private_key(ec.SECP256R1())


def private_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    """Encode a private key for a file."""
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
    )


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    """Make the extension for a key's usage."""
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )


def _common_name(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write(file: Path, content: bytes) -> None:
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
        out.write(content)
