"""What a program needs in order to take part in a run."""

from dataclasses import dataclass, field, replace

from phalanx.wire.keys import Keys
from phalanx.wire.seal import Sealer


@dataclass(frozen=True)
class Membership:
    """Which run, where its hub is, the secret that its programs share, and who one is in it."""

    run: str
    """Part of every key expression."""
    endpoint: str
    """Where the plant listens and everybody else connects, as Zenoh writes it."""
    secret: bytes = field(default=b"", repr=False)
    """Seals the run's messages; with none, corruption is detected but not forgery."""
    identity: str = ""
    """The program's name: an agent's, or PLANT; empty for who only listens."""
    timeout: float = 60.0
    """How long to try to reach the hub [s of wall time]."""

    @property
    def keys(self) -> Keys:
        """The run's key expressions."""
        return Keys(self.run)

    @property
    def sealer(self) -> Sealer:
        """Seals and opens the run's messages."""
        return Sealer(self.secret)

    def of(self, identity: str) -> "Membership":
        """The same run's membership for another program."""
        return replace(self, identity=identity)
