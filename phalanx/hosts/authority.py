"""One certificate for each program of a run, by an authority of the run's own."""

import datetime
import ipaddress
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Self

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from phalanx.wire.credentials import AUTHORITY, AUTHORITY_KEY, CERTIFICATE, PRIVATE_KEY
from phalanx.wire.keys import HUBS, PLANT

_CLOCKS_DIFFER = datetime.timedelta(minutes=5)


def signer(certificates: Path) -> Callable[[str, bytes], bytes]:
    """Makes the certificate of a name for a public key, by the authority's key in a plant's folder.

    It raises ValueError where there is none. Raises OSError, ValueError: the key cannot be read.
    """
    authority = Authority.read(certificates)

    def sign(name: str, public_key: bytes) -> bytes:
        if authority is None:
            raise ValueError("the plant's certificate was made without `phalanx keys --claims`")
        return authority.sign(name, read_public(public_key))

    return sign


class Authority:
    """Says which public key is whose."""

    def __init__(self, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
        self._certificate, self._key = certificate, key

    @classmethod
    def new(cls, valid: datetime.timedelta) -> Self:
        """One that nobody knows yet; all that it signs ends with it."""
        key = new_key()
        name = _named("phalanx run")
        now = datetime.datetime.now(datetime.UTC)
        certificate = (
            _begun(name, name, key.public_key())
            .not_valid_before(now + min(valid, datetime.timedelta()) - _CLOCKS_DIFFER)
            .not_valid_after(now + valid)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_certificates=True), critical=True)
            .sign(key, hashes.SHA256())
        )
        return cls(certificate, key)

    @classmethod
    def read(cls, folder: Path) -> Self | None:
        """The one whose key is in a plant's folder, if it is. Raises OSError, ValueError."""
        if not (folder / AUTHORITY_KEY).exists():
            return None
        key = serialization.load_pem_private_key((folder / AUTHORITY_KEY).read_bytes(), None)
        assert isinstance(key, ec.EllipticCurvePrivateKey)
        return cls(x509.load_pem_x509_certificate((folder / AUTHORITY).read_bytes()), key)

    @property
    def certificate(self) -> bytes:
        """Its own, PEM."""
        return self._certificate.public_bytes(serialization.Encoding.PEM)

    @property
    def private_key(self) -> bytes:
        """The key that it signs with, PEM."""
        return private_pem(self._key)

    def sign(self, name: str, key: ec.EllipticCurvePublicKey, hosts: Iterable[str] = ()) -> bytes:
        """A certificate, PEM: who has the key's other half is `name`; a hub is reached at `hosts`.

        With no hosts it is good for connecting alone, and its owner cannot pass for a hub.
        """
        own = self._certificate
        builder = (
            _begun(_named(name), own.subject, key)
            .not_valid_before(own.not_valid_before_utc)
            .not_valid_after(own.not_valid_after_utc)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_certificates=False), critical=True)
        )
        usage = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if reached_as := [_host(host) for host in hosts]:
            usage.append(ExtendedKeyUsageOID.SERVER_AUTH)
            alternatives = x509.SubjectAlternativeName(reached_as)
            builder = builder.add_extension(alternatives, critical=False)
        builder = builder.add_extension(x509.ExtendedKeyUsage(usage), critical=False)
        signed = builder.sign(self._key, hashes.SHA256())
        return signed.public_bytes(serialization.Encoding.PEM)


def make_certificates(
    folder: Path,
    names: Iterable[str],
    hosts: Iterable[str],
    valid: datetime.timedelta,
    claims: bool = False,
) -> None:
    """Make an authority, and a folder with a certificate and its private key for each name.

    Args:
        folder: of these folders; new, or empty; only its owner may look into it.
        names: of the programs; each becomes the common name of its certificate.
        hosts: names and addresses under which the hub is reached.
        valid: for how long.
        claims: whether the plant keeps the authority's key, to sign for who claims a place. Else
            nobody does, and nobody can add a name later.

    Raises:
        FileExistsError: there is something in the folder. OSError: it cannot be written.
    """
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise FileExistsError(f"{folder}: expected a folder that is new or empty")
    authority, reached_as = Authority.new(valid), tuple(hosts)
    for name in names:
        (own := folder / name).mkdir(mode=0o700)
        key = new_key()
        write_certificate(
            own,
            authority.certificate,
            authority.sign(name, key.public_key(), reached_as if name in HUBS else ()),
            private_pem(key),
        )
        if claims and name == PLANT:
            _write(own / AUTHORITY_KEY, authority.private_key)


def require_current(folder: Path) -> None:
    """Refuse keys that older versions made: there each member's certificate served as a hub's.

    Raises ValueError: they are such, or no certificate. OSError: it cannot be read.
    """
    certificate = x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())
    try:
        certificate.extensions.get_extension_for_class(x509.KeyUsage)
    except x509.ExtensionNotFound as error:
        why = "keys of an older version, with which an agent can pass for the plant"
        raise ValueError(why) from error


def write_certificate(folder: Path, authority: bytes, certificate: bytes, key: bytes) -> None:
    """Write one program's three files, PEM, for their owner alone. Raises OSError."""
    _write(folder / AUTHORITY, authority)
    _write(folder / CERTIFICATE, certificate)
    _write(folder / PRIVATE_KEY, key)


def new_key() -> ec.EllipticCurvePrivateKey:
    """Another private key; its public half is what an authority signs."""
    return ec.generate_private_key(ec.SECP256R1())


def private_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    """A private key as a file has it."""
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def public_der(key: ec.EllipticCurvePrivateKey) -> bytes:
    """Its public half as a message has it."""
    return key.public_key().public_bytes(
        serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo
    )


def read_public(der: bytes) -> ec.EllipticCurvePublicKey:
    """The public key in a message. Raises ValueError: it is none on the curve P-256."""
    try:
        key = serialization.load_der_public_key(der)
    except Exception as error:  # the library's parsers raise of many kinds
        raise ValueError("not a public key") from error
    if not isinstance(key, ec.EllipticCurvePublicKey) or not isinstance(key.curve, ec.SECP256R1):
        raise ValueError("not a public key on the curve P-256")
    return key


def _begun(
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
    """What a key is for; require_current knows certificates of before by its absence."""
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


def _named(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _write(file: Path, content: bytes) -> None:
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
        out.write(content)
