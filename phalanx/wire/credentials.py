"""How a program shows the hub who it is, and what the hub holds that against."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from phalanx.wire.certificates import tls

SECRET, COMMAND_SECRET = "PHALANX_SECRET", "PHALANX_COMMAND_SECRET"
"""Variables of the environment that have the run's secrets; no agent of a launcher's gets them."""


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
    """As phalanx.wire.access makes it."""
    certificates: Path | None = None
    """The folder of the hub's certificate; whoever has one of the same authority is let in, and
    no password is asked for."""
