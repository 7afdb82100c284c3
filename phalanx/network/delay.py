"""Delays of messages: netem's `delay`, `reorder`, `rate` and `slot`, and a floor by distance."""

import math
from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Lt

from phalanx.network.distributions import Distribution, quantile
from phalanx.network.loss import NonNegative, Probability
from phalanx.network.rule import BASIC, DELIVER, DROP, Copy, Message, Treatment, delay

Positive = Annotated[float, Gt(0)]

_ROUNDING = 1e-6
"""Of a wait, as a share of the time that a message takes."""


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


@dataclass(frozen=True)
class Rate:
    """netem's `rate` and `limit`: one message after the other, as fast as the link is.

    The only rule with a memory: of when the message before was through. A receiver decides a
    link's messages in the order of their numbers, so even this depends on nothing else.
    """

    bits_per_second: Positive
    size: Positive = 128.0
    """Of every message, with all that the link adds to it [bytes]."""
    limit: Annotated[int, Ge(1)] = 1000
    """Most messages in the queue, with the one being carried; to a full one nothing is added."""

    def treat(self, message: Message) -> Treatment:
        """Delay until the link has carried it."""
        takes = 8.0 * self.size / self.bits_per_second
        begins = max(message.t, message.previous)
        # One that waits longer finds `limit` before it, the one being carried among them.
        if begins - message.t > (self.limit - 1 + _ROUNDING) * takes:
            return DROP
        return delay(begins + takes - message.t)


@dataclass(frozen=True)
class Slot:
    """netem's `slot`: what has come is delivered at the end of each slot, all at once."""

    every: Positive
    """[s]"""

    def treat(self, message: Message) -> Treatment:
        """Delay to the end of the slot."""
        slots = message.t / self.every
        if not math.isfinite(slots):
            # Who lies about when it sent may name a time that no slot has a number for.
            return DELIVER
        return delay(max(0.0, math.ceil(slots) * self.every - message.t))
