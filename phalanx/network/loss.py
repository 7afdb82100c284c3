"""Rules that drop, duplicate or corrupt messages: by chance, in bursts, by distance."""

from dataclasses import dataclass
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
class Chance:
    """netem's `PERCENT CORRELATION`."""

    probability: Probability
    correlation: Annotated[float, Ge(0), Lt(1)] = 0.0
    """Correlation of consecutive messages."""

    def hits(self, message: Message, purpose: str) -> bool:
        """Return whether it happens to this message."""
        return message.draw(purpose, correlation=self.correlation) < self.probability


@dataclass(frozen=True)
class RandomLoss:
    """netem's `loss random PERCENT CORRELATION`."""

    chance: Chance

    @property
    def mean(self) -> float:
        """Share of messages lost."""
        return self.chance.probability

    def __str__(self) -> str:
        correlation = self.chance.correlation
        return f"{100 * self.chance.probability:g} %" + (
            f", correlation {correlation:g}" if correlation else ""
        )

    def treat(self, message: Message) -> Treatment:
        return DROP if self.chance.hits(message, BASIC) else DELIVER


@dataclass(frozen=True)
class GilbertElliott:
    """netem's `loss gemodel p r 1-h 1-k`: a link with two states, good and bad."""

    p: Probability
    """Probability that a good link is bad at the next message."""
    r: Probability
    """Probability that a bad link is good at the next message."""
    lost_if_bad: Probability = 1.0
    """1-h."""
    lost_if_good: Probability = 0.0
    """1-k."""

    def __post_init__(self) -> None:
        if self.p + self.r == 0.0:
            raise ValueError("expected p or r above 0: else the link never changes its state")

    def __str__(self) -> str:
        return f"{100 * self.mean:.4g} % in bursts"

    @property
    def mean(self) -> float:
        """Share of messages lost in the long run."""
        bad = self.p / (self.p + self.r)
        return bad * self.lost_if_bad + (1.0 - bad) * self.lost_if_good

    def treat(self, message: Message) -> Treatment:
        lost = self.lost_if_bad if self._bad(message) else self.lost_if_good
        return DROP if message.draw(BASIC) < lost else DELIVER

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


def bursts(mean: float, burst: float) -> GilbertElliott:
    """Build the simple Gilbert model from measurable quantities.

    Args:
        mean: share of messages lost, below 1.
        burst: mean number of messages lost in a row, at least 1.

    Raises:
        ValueError: the bursts are too short for this share.
    """
    r = 1.0 / burst
    p = mean * r / (1.0 - mean)
    if p > 1.0:
        least = mean / (1.0 - mean)
        raise ValueError(f"expected burst >= {least:.4g} for a mean loss of {mean:g}, got {burst}")
    return GilbertElliott(p, r)


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

    chance: Chance

    def treat(self, message: Message) -> Treatment:
        return DUPLICATE if self.chance.hits(message, "duplicate") else DELIVER


@dataclass(frozen=True)
class Corrupt:
    """netem's `corrupt`: a flipped byte in some messages."""

    chance: Chance

    def treat(self, message: Message) -> Treatment:
        return CORRUPT if self.chance.hits(message, "corrupt") else DELIVER
