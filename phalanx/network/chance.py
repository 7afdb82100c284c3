"""Something that befalls a share of all messages, independently or in runs."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Le, Lt

from phalanx.network.rule import CORRUPT, DELIVER, DUPLICATE, Message, Treatment

NonNegative = Annotated[float, Ge(0)]
Probability = Annotated[float, Ge(0), Le(1)]


@dataclass(frozen=True)
class Chance:
    """netem's `PERCENT CORRELATION`."""

    probability: Probability
    correlation: Annotated[float, Ge(0), Lt(1)] = 0.0
    """Of what befalls one message and the next."""

    def befalls(self, message: Message, purpose: str) -> bool:
        """Whether it befalls this message."""
        return message.draw(purpose, kept=self.correlation) < self.probability


@dataclass(frozen=True)
class Duplicate:
    """A second copy of some messages, which goes its own way: netem's `duplicate`."""

    chance: Chance

    def treat(self, message: Message) -> Treatment:
        """Duplicate by chance."""
        return DUPLICATE if self.chance.befalls(message, "duplicate") else DELIVER


@dataclass(frozen=True)
class Corrupt:
    """A flipped byte in some messages: netem's `corrupt`."""

    chance: Chance

    def treat(self, message: Message) -> Treatment:
        """Corrupt by chance."""
        return CORRUPT if self.chance.befalls(message, "corrupt") else DELIVER
