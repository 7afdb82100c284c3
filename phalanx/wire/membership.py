"""What a program needs in order to take part in a run."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from phalanx.wire.credentials import Credentials
from phalanx.wire.keys import EVERYBODY, PLANT, VIEWER, Keys, link, owner
from phalanx.wire.seal import RunSealer, Sealer


@dataclass(frozen=True)
class Membership:
    """Which run, where its hub is, who one is in it, and what proves that."""

    run: str
    """Part of every key expression."""
    endpoint: str
    """Where the plant listens and everybody else connects, as Zenoh writes it."""
    secret: bytes = field(default=b"", repr=False)
    """The run's. Who has it can be anybody in the run; with none, so can everybody."""
    identity: str = VIEWER
    """The program's name: an agent's, or another of phalanx.wire.keys."""
    timeout: float = 60.0
    """How long to try to reach the hub [s of wall time]."""
    certificates: Path | None = None
    """The folder of its certificate, where certificates and not passwords say who is who."""
    held: Mapping[str, bytes] | None = field(default=None, repr=False)
    """The keys of those that one may be, in place of the secret from which all are made."""

    @property
    def keys(self) -> Keys:
        """The run's key expressions."""
        return Keys(self.run)

    @property
    def sealer(self) -> Sealer:
        """Seals and opens the run's messages, each with the key of the program that it is about."""
        return RunSealer(lambda key: self.key_of(owner(key)))

    @property
    def credentials(self) -> Credentials:
        """What the hub asks for before it lets this program in."""
        return Credentials(self.identity, self.password_of(self.identity), self.certificates)

    def key_of(self, name: str) -> bytes:
        """The key of a program, or the one that everybody in the run has. Raises KeyError.

        A key tells nothing of another, nor of the secret.
        """
        if self.held is not None:
            return self.held[name]
        return hashlib.blake2b(name.encode(), key=self._root, digest_size=32).digest()

    @cached_property
    def _root(self) -> bytes:
        return hashlib.blake2b(self.secret, digest_size=32).digest()

    def password_of(self, name: str) -> str:
        """What a program shows at the hub's door; it tells nothing of its key."""
        return hashlib.blake2b(b"password", key=self.key_of(name), digest_size=16).hexdigest()

    def of(
        self, identity: str, speaks_for: tuple[str, ...] = (), peers: tuple[str, ...] = ()
    ) -> "Membership":
        """What one program of the run gets: its own keys; the secret is the plant's alone.

        Args:
            identity: its name.
            speaks_for: the agents that it decides for: itself, if it is one.
            peers: all agents; their broadcasts are sealed with a key for each link.
        """
        if identity == PLANT:
            return replace(self, identity=PLANT)
        links = {link(*ends) for i in speaks_for for j in peers for ends in ((i, j), (j, i))}
        held = {name: self.key_of(name) for name in (EVERYBODY, identity, *speaks_for, *links)}
        return replace(self, identity=identity, secret=b"", held=held)
