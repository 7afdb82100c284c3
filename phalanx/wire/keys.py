"""Key expressions: phalanx/<run>/<kind>/<agent>, every chunk at a fixed depth."""

from dataclasses import dataclass

PLANT = "plant"
"""The plant's name where an agent's would stand; scenarios cannot use it."""


@dataclass(frozen=True)
class Keys:
    """The key expressions of one run."""

    run: str

    def sample(self, agent: str) -> str:
        """Plant to one agent: its sampled state."""
        return f"phalanx/{self.run}/sample/{agent}"

    def input(self, agent: str) -> str:
        """One agent to everyone: its broadcast input; "*" for all agents."""
        return f"phalanx/{self.run}/input/{agent}"

    def alive(self, name: str, digest: str = "*") -> str:
        """Liveliness token of a program, with the digest of the scenario it runs."""
        return f"phalanx/{self.run}/alive/{name}/{digest}"

    @property
    def status(self) -> str:
        """Plant to everyone: progress."""
        return f"phalanx/{self.run}/status/{PLANT}"

    @property
    def view(self) -> str:
        """Plant to viewers: the run as it goes."""
        return f"phalanx/{self.run}/view/{PLANT}"

    @property
    def scenario(self) -> str:
        """Asked of the plant: the resolved scenario."""
        return f"phalanx/{self.run}/scenario/{PLANT}"

    @property
    def control(self) -> str:
        """Whoever has the control secret to the plant: a command."""
        return f"phalanx/{self.run}/control/{PLANT}"

    @property
    def verdict(self) -> str:
        """Plant to everyone: the end of the run."""
        return f"phalanx/{self.run}/verdict/{PLANT}"


def sender(key: str) -> str:
    """The agent in a key of kind sample, input or alive."""
    return key.split("/")[3]
