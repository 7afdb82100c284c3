"""Rules that drop, duplicate or corrupt messages: by chance, in bursts, by distance."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, NamedTuple

from annotated_types import Ge, Lt

from phalanx.network.rule import (
    BASIC,
    CORRUPT,
    DELIVER,
    DROP,
    DUPLICATE,
    Message,
    Treatment,
)
from phalanx.schema.fields import NonNegative, Probability
from phalanx.theory.arrays import Array, Mask


@dataclass(frozen=True)
class RandomLoss:
    """netem's `loss random PERCENT`."""

    probability: Probability

    @property
    def mean(self) -> float:
        """Share of messages lost."""
        return self.probability

    def __str__(self) -> str:
        return f"{100 * self.probability:g} %"

    def treat(self, message: Message) -> Treatment:
        return DROP if message.draw(BASIC) < self.probability else DELIVER


@dataclass(frozen=True)
class Bursts:
    """Gilbert's model: a link with two states that loses everything while it is bad."""

    mean: Annotated[Probability, Lt(1)]
    """Share of messages lost."""
    burst: Annotated[float, Ge(1)]
    """Mean number of messages lost in a row."""

    def __post_init__(self) -> None:
        if self.p > 1.0:
            least = self.mean / (1.0 - self.mean)
            raise ValueError(
                f"expected burst >= {least:.4g} for a mean loss of {self.mean:g}, got {self.burst}"
            )

    @cached_property
    def r(self) -> float:
        """Probability that a bad link is good at the next message."""
        return 1.0 / self.burst

    @cached_property
    def p(self) -> float:
        """Probability that a good link is bad at the next message."""
        return self.mean * self.r / (1.0 - self.mean)

    def __str__(self) -> str:
        return f"{100 * self.mean:.4g} % in bursts"

    def treat(self, message: Message) -> Treatment:
        return DROP if self._bad(message) else DELIVER

    def _bad(self, message: Message) -> bool:
        """Return whether the link is bad at message k, for messages in any order.

        One draw u turns a good link bad if u < p, and keeps a bad one bad if u < 1 - r. If u is
        below both or above both, the state before has no effect: the search back ends there.
        """
        both, either = sorted((self.p, 1.0 - self.r))
        draws = message.tables["state of the link"]
        k = draws.last(message.k, Outside(both, either))
        # The first message has the long-run distribution of the state.
        bad = draws.value(k) < (both if k else self.p / (self.p + self.r))
        # Between both the state stays, or, if p > 1 - r, changes at each message.
        return bad ^ (self.p > 1.0 - self.r and (message.k - k) % 2 == 1)


class Outside(NamedTuple):
    """Rows of draws whose first draw lies outside [low, high)."""

    low: float
    high: float

    def __call__(self, rows: Array, /) -> Mask:
        return (rows[:, 0] < self.low) | (rows[:, 0] >= self.high)


@dataclass(frozen=True)
class DistanceLoss:
    """Loss by distance: none within one distance, all beyond another, linear between."""

    none_within: NonNegative
    """[m]"""
    all_beyond: NonNegative
    """[m]"""

    asks_distance = True

    def __post_init__(self) -> None:
        if self.none_within > self.all_beyond:
            message = "expected none_within <= all_beyond"
            raise ValueError(f"{message}, got {self.none_within} > {self.all_beyond}")

    def treat(self, message: Message) -> Treatment:
        over, width = message.distance - self.none_within, self.all_beyond - self.none_within
        if over <= 0.0:
            return DELIVER
        return DROP if over >= width * message.draw("distance") else DELIVER


@dataclass(frozen=True)
class Duplicate:
    """netem's `duplicate`: a second copy of some messages, treated separately by later rules."""

    probability: Probability

    def treat(self, message: Message) -> Treatment:
        return DUPLICATE if message.draw("duplicate") < self.probability else DELIVER


@dataclass(frozen=True)
class Corrupt:
    """netem's `corrupt`: a flipped byte in some messages."""

    probability: Probability

    def treat(self, message: Message) -> Treatment:
        return CORRUPT if message.draw("corrupt") < self.probability else DELIVER
