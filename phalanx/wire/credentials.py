"""How a program shows the hub who it is: a password, or a certificate.

A certificate is three files in a folder, whose names are those of a Kubernetes TLS secret: it can
be mounted as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

SECRET, COMMAND_SECRET = "PHALANX_SECRET", "PHALANX_COMMAND_SECRET"
"""Variables of the environment that have the run's secrets; no agent of a launcher's gets them."""
AUTHORITY, CERTIFICATE, PRIVATE_KEY = "ca.crt", "tls.crt", "tls.key"
AUTHORITY_KEY = "ca.key"
"""Beside them in the plant's folder, where agents may claim places."""
ENDPOINT = "endpoint"
"""Beside them where the hub's host was known: where to connect to."""


def tls(folder: Path, role: Literal["listen", "connect"]) -> dict[str, Any]:
    """Zenoh's `tls` of one program: both ends show a certificate of the run's authority.

    Who connects goes on only if the hub's is good for the host that it connected to.
    """
    return {
        "enable_mtls": True,
        "root_ca_certificate": str(folder / AUTHORITY),
        f"{role}_certificate": str(folder / CERTIFICATE),
        f"{role}_private_key": str(folder / PRIVATE_KEY),
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


@dataclass(frozen=True)
class Credentials:
    """How a program shows the hub who it is."""

    name: str
    password: str = field(repr=False)
    """Never sent: it proves itself by its answer to what the hub asks."""
    certificates: Path | None = None
    """The folder of its own certificate, which takes the password's place."""

    def to_connect(self) -> dict[str, Any]:
        """A client's part of Zenoh's `transport`."""
        if self.certificates is None:
            return {"auth": {"usrpwd": {"user": self.name, "password": self.password}}}
        return {"link": {"tls": tls(self.certificates, "connect")}}


@dataclass(frozen=True)
class Admission:
    """Whom a hub lets in, and what each may do there."""

    passwords: Mapping[str, str] = field(repr=False)
    """By name."""
    access_control: Mapping[str, Any]
    """As phalanx.identities.access makes it."""
    certificates: Path | None = None
    """The folder of the hub's certificate; whoever has one of the same authority is let in, and
    no password is asked for."""
