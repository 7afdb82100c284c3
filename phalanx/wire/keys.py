"""Key expressions: phalanx/<run>/<kind>/<name>, every chunk at a fixed depth.

A broadcast's has its receiver's name behind its sender's, a token's the digest of its scenario, and
a copy's the kind and name of what it is a copy of.
"""

from dataclasses import dataclass

PLANT = "plant"
"""The plant's name where an agent's would stand; scenarios cannot use it."""
VIEWER = "viewer"
"""Whoever looks at a run without taking part; scenarios cannot use the name."""
OPERATOR = "operator"
"""A viewer that may command, where certificates say who is who; scenarios cannot use the name."""
ROUTER = "router"
"""The program that all others meet in where the plant is not it; scenarios cannot use the name."""
CLAIMANT = "claimant"
"""Who asks for an agent's place and is nobody yet; scenarios cannot use the name."""
HUBS = (PLANT, ROUTER)
"""Whom the others connect to; nobody else may be taken for it."""
EVERYBODY = ""
"""The name of no program: of what all of a run have."""

NOT_URGENT = tuple(
    f"phalanx/*/{kind}/**" for kind in ("actuation", "broadcast", "telemetry", "command")
)
"""What members of any run may put."""


_SEEN_BY_ALL = ("status", "frame", "verdict")
_COPY = "copy"
COPIES = f"phalanx/*/{_COPY}/**"
"""Of what members of any run put, for those who look on."""


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
        """One agent to one of its peers: the input it says it applies."""
        return f"{self._key('broadcast', sender)}/{receiver}"

    def telemetry(self, agent: str) -> str:
        """One agent to the plant: how its input was made."""
        return self._key("telemetry", agent)

    def alive(self, name: str, digest: str = "*") -> str:
        """Liveliness token of a program, with the digest of the scenario it runs."""
        return f"{self._key('alive', name)}/{digest}"

    @property
    def status(self) -> str:
        """Plant to everyone: progress."""
        return self._key("status")

    @property
    def frames(self) -> str:
        """Plant to viewers: the run as it goes."""
        return self._key("frame")

    @property
    def scenario(self) -> str:
        """Asked of the plant: the resolved scenario."""
        return self._key("scenario")

    @property
    def place(self) -> str:
        """Asked of the plant by a claimant: a free agent's place."""
        return self._key("place")

    @property
    def command(self) -> str:
        """Whoever has the command secret to the plant: a command."""
        return self._key("command")

    @property
    def verdict(self) -> str:
        """Plant to everyone: the end of the run."""
        return self._key("verdict")

    @property
    def from_plant(self) -> tuple[str, ...]:
        """Whatever the plant puts."""
        sample = self.sample("*")
        return sample, self.copy(sample), self.status, self.frames, self.verdict

    @property
    def to_viewers(self) -> tuple[str, ...]:
        """Whatever is dropped where it is not taken."""
        return self.copies, self.status, self.frames, self.verdict

    @property
    def to_plant(self) -> tuple[str, ...]:
        """Whatever is put for the plant."""
        return self.actuation("*"), self.telemetry("*"), self.command

    def of(self, name: str) -> str:
        """Whatever one program puts."""
        return f"{self._key('*', name)}/**"

    def seen(self, kind: str) -> str:
        """Where those who look on find messages of a kind."""
        every = f"phalanx/{self.run}/{kind}/**"
        return every if kind in _SEEN_BY_ALL else self.copy(every)

    def copy(self, key: str) -> str:
        """Whoever puts on a key to those who look on: the same, put once more."""
        return self._key(_COPY, key.removeprefix(f"phalanx/{self.run}/"))

    def original(self, copy: str) -> str:
        """What a key was before it was a copy's; any other stays as it is."""
        return copy.replace(self.copy(""), f"phalanx/{self.run}/", 1)

    @property
    def copies(self) -> str:
        """Every copy."""
        return self.copy(self.everything)

    @property
    def everything(self) -> str:
        """Whatever is put in the run."""
        return f"phalanx/{self.run}/**"


def kind_and_name(key: str) -> tuple[str, str]:
    """The kind of a run's key expression and the name in it; two empty texts if it is no such.

    Somebody may put on a wildcard: that is no key of a run.
    """
    chunks = key.split("/")
    if len(chunks) not in (4, 5) or chunks[0] != "phalanx" or "*" in key:
        return "", ""
    return chunks[2], chunks[3]


_ONES_OWN = {"sample", "actuation", "telemetry"}


def link(sender: str, receiver: str) -> str:
    """The name of what two agents have alone, in this direction; no program's."""
    return f"{sender}>{receiver}"


def owner(key: str) -> str:
    """Whose key seals what is put on a key expression.

    The agent's own between it and the plant, a link's between two agents, a claimant's where it
    asks for a place; else everybody's.
    """
    kind, name = kind_and_name(key)
    if kind == "place":
        return CLAIMANT
    if kind == "broadcast":
        return link(name, key.rsplit("/", 1)[-1])
    return name if kind in _ONES_OWN else EVERYBODY
