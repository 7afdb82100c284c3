"""Credentials that a program shows the hub: a password, or a TLS identity.

An identity is three files in a folder: an X.509 certificate, its private key, and the authority's
certificate. They are named as in a Kubernetes TLS secret, which can be mounted as it is.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

SECRET, COMMAND_SECRET = "PHALANX_SECRET", "PHALANX_COMMAND_SECRET"
"""Environment variables of the run's secrets; a launcher's agents do not get them."""
AUTHORITY, CERTIFICATE, PRIVATE_KEY = "ca.crt", "tls.crt", "tls.key"
ENDPOINT = "endpoint"
"""A fourth file, if the hub's host was known: the endpoint to connect to."""


def tls(folder: Path, role: Literal["listen", "connect"]) -> dict[str, Any]:
    """Return Zenoh's `tls` table of one program, with mutual authentication.

    A client also verifies that the hub's identity is valid for the host that it connects to.
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
    """The name of a program, and its password or TLS identity."""

    name: str
    password: str = field(repr=False)
    """Never sent: it is proven by the answer to a challenge of the hub."""
    identity_folder: Path | None = None
    """The folder of its TLS identity, in place of the password."""

    def to_connect(self) -> dict[str, Any]:
        """Return a client's part of Zenoh's `transport`."""
        if self.identity_folder is None:
            return {"auth": {"usrpwd": {"user": self.name, "password": self.password}}}
        return {"link": {"tls": tls(self.identity_folder, "connect")}}


@dataclass(frozen=True)
class Admission:
    """The programs that a hub admits, and their permissions."""

    passwords: Mapping[str, str] = field(repr=False)
    """By name."""
    access_control: Mapping[str, Any]
    """As phalanx.messages.admission makes it."""
    identity_folder: Path | None = None
    """The folder of the hub's TLS identity; it then admits identities of the same authority in
    place of passwords."""
