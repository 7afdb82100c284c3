"""Membership of a program in a run: name, hub, secret keys and TLS identity."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from phalanx.messages.credentials import Credentials
from phalanx.messages.keys import PLANT, SHARED, VIEWER, Keys, link, owner
from phalanx.messages.seal import RunSealer, Sealer


@dataclass(frozen=True)
class Membership:
    """A program's name in a run, the hub's endpoint, and the secrets that prove the name."""

    run: str
    """Part of every key expression."""
    endpoint: str
    """The hub's Zenoh endpoint."""
    secret: bytes = field(default=b"", repr=False)
    """The run's secret, from which all keys are derived; its owner can pass for any program."""
    identity: str = VIEWER
    """The program's name: an agent's, or another of phalanx.messages.keys."""
    timeout: float = 60.0
    """Time to reach the hub [s of wall time]."""
    identity_folder: Path | None = None
    """The folder of its TLS identity, in place of a password."""
    held: Mapping[str, bytes] | None = field(default=None, repr=False)
    """The program's own keys by name, in place of the secret."""

    @property
    def keys(self) -> Keys:
        """The run's key expressions."""
        return Keys(self.run)

    @property
    def sealer(self) -> Sealer:
        """Seals and opens the run's messages, each with the secret key of its owner."""
        return RunSealer(lambda key: self.key_of(owner(key)))

    @property
    def credentials(self) -> Credentials:
        """The credentials that the hub requires of this program."""
        return Credentials(self.identity, self.password_of(self.identity), self.identity_folder)

    def key_of(self, name: str) -> bytes:
        """Return the secret key of a name, or the SHARED one. Raises KeyError.

        Neither another key nor the secret can be computed from it.
        """
        if self.held is not None:
            return self.held[name]
        return hashlib.blake2b(name.encode(), key=self._root, digest_size=32).digest()

    @cached_property
    def _root(self) -> bytes:
        return hashlib.blake2b(self.secret, digest_size=32).digest()

    def password_of(self, name: str) -> str:
        """Return a program's password for the hub; its key cannot be computed from it."""
        return hashlib.blake2b(b"password", key=self.key_of(name), digest_size=16).hexdigest()

    def of(
        self, identity: str, speaks_for: tuple[str, ...] = (), peers: tuple[str, ...] = ()
    ) -> "Membership":
        """Return one program's membership, with its own keys alone; the plant's has the secret.

        Args:
            identity: its name.
            speaks_for: the agents that it decides for: itself, if it is one.
            peers: all agents; their broadcasts are sealed with a key for each link.
        """
        if identity == PLANT:
            return replace(self, identity=PLANT)
        links = {link(*ends) for i in speaks_for for j in peers for ends in ((i, j), (j, i))}
        held = {name: self.key_of(name) for name in (SHARED, identity, *speaks_for, *links)}
        return replace(self, identity=identity, secret=b"", held=held)
