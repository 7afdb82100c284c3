"""Key expressions: phalanx/<run>/<kind>/<name>, every chunk at a fixed depth.

A broadcast's key continues with its receiver's name, a token's with the digest of its scenario.
"""

from dataclasses import dataclass

PLANT = "plant"
VIEWER = "viewer"
"""A program that watches a run without taking part."""
OPERATOR = "operator"
"""A viewer that may command, where programs have TLS identities."""
ROUTER = "router"
"""A hub apart from the plant."""
HUBS = (PLANT, ROUTER)
"""The programs that others connect to; no other may pass for one."""
SHARED = ""
"""In place of a name: the key that all programs of a run have."""

NOT_URGENT = tuple(
    f"phalanx/*/{kind}/**" for kind in ("actuation", "broadcast", "telemetry", "command")
)
"""Messages of programs other than the plant, in any run."""


@dataclass(frozen=True)
class Keys:
    """The key expressions of one run; "*" as a name stands for all agents."""

    run: str

    def _key(self, kind: str, name: str = PLANT) -> str:
        return f"phalanx/{self.run}/{kind}/{name}"

    def sample(self, agent: str) -> str:
        """Plant to one agent: its sampled state."""
        return self._key("sample", agent)

    def actuation(self, agent: str) -> str:
        """One agent to its actuator in the plant: the input it applies."""
        return self._key("actuation", agent)

    def broadcast(self, sender: str, receiver: str) -> str:
        """One agent to one of its peers: the input that it claims to apply."""
        return f"{self._key('broadcast', sender)}/{receiver}"

    def telemetry(self, agent: str) -> str:
        """One agent to the plant: how its input was made."""
        return self._key("telemetry", agent)

    def alive(self, name: str, digest: str = "*") -> str:
        """Liveliness token of a program, with the digest of its scenario."""
        return f"{self._key('alive', name)}/{digest}"

    @property
    def status(self) -> str:
        """Plant to everyone: progress."""
        return self._key("status")

    @property
    def frames(self) -> str:
        """Plant to viewers: the state of the run."""
        return self._key("frame")

    @property
    def scenario(self) -> str:
        """Query to the plant: the resolved scenario."""
        return self._key("scenario")

    @property
    def command(self) -> str:
        """Viewer with the command secret to the plant: a command."""
        return self._key("command")

    @property
    def verdict(self) -> str:
        """Plant to everyone: the end of the run."""
        return self._key("verdict")

    @property
    def from_plant(self) -> tuple[str, ...]:
        """All that the plant puts."""
        return self.sample("*"), self.status, self.frames, self.verdict

    @property
    def to_viewers(self) -> tuple[str, ...]:
        """All that viewers may subscribe to: the hub drops what they do not read in time."""
        return self.status, self.frames, self.verdict

    @property
    def to_plant(self) -> tuple[str, ...]:
        """All that the plant subscribes to."""
        return self.actuation("*"), self.telemetry("*"), self.command

    @property
    def everything(self) -> str:
        """All messages of the run."""
        return f"phalanx/{self.run}/**"


def kind_and_name(key: str) -> tuple[str, str]:
    """Return the kind and the name in a run's key; two empty texts if it is no such key.

    A key with a wildcard, on which an attacker may put, is not one.
    """
    chunks = key.split("/")
    if len(chunks) not in (4, 5) or chunks[0] != "phalanx" or "*" in key:
        return "", ""
    return chunks[2], chunks[3]


_AGENT_KINDS = {"sample", "actuation", "telemetry"}


def link(sender: str, receiver: str) -> str:
    """Return the name of the secret key that two agents share for one direction."""
    return f"{sender}>{receiver}"


def owner(key: str) -> str:
    """Return the name of the secret key that seals messages on a key expression.

    It is the agent's between it and the plant, the link's between two agents, and else the shared
    one.
    """
    kind, name = kind_and_name(key)
    if kind == "broadcast":
        return link(name, key.rsplit("/", 1)[-1])
    return name if kind in _AGENT_KINDS else SHARED
