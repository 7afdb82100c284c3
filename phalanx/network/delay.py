"""How long messages take: netem's `delay`, `reorder` and a floor by distance."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Lt

from phalanx.network.chance import NonNegative, Probability
from phalanx.network.distributions import Distribution, quantile
from phalanx.network.rule import DELIVER, Copy, Message, Treatment, delay

BASIC = ""
"""The purpose of the two draws that each message has on each link: for loss, and for delay."""


@dataclass(frozen=True)
class ConstantDelay:
    """Every message takes as long."""

    time: NonNegative
    """[s]"""

    def __str__(self) -> str:
        return f"{1e3 * self.time:.4g} ms"

    def treat(self, message: Message) -> Treatment:
        """Delay."""
        return delay(self.time)


@dataclass(frozen=True)
class UniformDelay:
    """A delay drawn anew for every message, uniformly between two bounds."""

    low: NonNegative
    """[s]"""
    high: NonNegative
    """[s]"""

    def __post_init__(self) -> None:
        if self.low > self.high:
            raise ValueError(f"expected low <= high, got {self.low} > {self.high}")

    def __str__(self) -> str:
        return f"{1e3 * self.low:g} to {1e3 * self.high:.4g} ms, uniform"

    def treat(self, message: Message) -> Treatment:
        """Delay."""
        return delay(self.low + message.draw(BASIC, 1) * (self.high - self.low))


@dataclass(frozen=True)
class JitteredDelay:
    """netem's `delay TIME JITTER CORRELATION distribution ...`; never below zero."""

    time: NonNegative
    """Mean [s]."""
    jitter: NonNegative
    """What the distribution is scaled with [s]: ± of a uniform one, σ of a normal one."""
    correlation: Annotated[float, Ge(0), Lt(1)] = 0.0
    """Of the delays of one message and the next."""
    distribution: Distribution = "uniform"

    def __str__(self) -> str:
        kept = f", correlation {self.correlation:g}" if self.correlation else ""
        return f"{1e3 * self.time:g} ± {1e3 * self.jitter:g} ms, {self.distribution}{kept}"

    def treat(self, message: Message) -> Treatment:
        """Delay."""
        place = message.draw(BASIC, 1, kept=self.correlation)
        return delay(max(0.0, self.time + self.jitter * quantile(self.distribution, place)))


@dataclass(frozen=True)
class DelayFloor:
    """No message takes less than its way does."""

    time: NonNegative = 0.0
    """At no distance [s]."""
    per_metre: NonNegative = 0.0
    """[s/m]"""

    asks_distance = True

    def treat(self, message: Message) -> Treatment:
        """Delay what came too early."""
        return delay(max(0.0, self.time + self.per_metre * message.distance - message.waited))


@dataclass(frozen=True)
class Reorder:
    """netem's `reorder PERCENT CORRELATION gap DISTANCE`: some messages are not delayed."""

    probability: Probability = 1.0
    correlation: Annotated[float, Ge(0), Lt(1)] = 0.0
    gap: Annotated[int, Ge(1)] = 1
    """Only every gap-th message is a candidate."""

    def treat(self, message: Message) -> Treatment:
        """Take back the delay of a message that goes first."""
        if (message.k + 1) % self.gap or message.waited == 0.0:
            return DELIVER
        hit = message.draw("reorder", kept=self.correlation) < self.probability
        return (Copy(-message.waited),) if hit else DELIVER
