"""Delays of messages: netem's `delay`, `reorder`, `rate` and `slot`, and a least one by distance.

Distributions have mean 0 and unit scale. Like netem's they are tables of quantiles, cut off at ±4;
the tables are bit-identical on every CPU.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Literal

import casadi as ca
import numpy as np
from annotated_types import Ge, Lt

from phalanx.network.rule import BASIC, DELIVER, DROP, Copy, Message, Treatment, delay
from phalanx.schema.fields import NonNegative, Positive, Probability
from phalanx.theory.arrays import Array
from phalanx.theory.expressions import exponential

_ROUNDING = 1e-6
"""Tolerance of a queue's length, in messages."""

Distribution = Literal["uniform", "normal", "pareto", "paretonormal"]

LONGEST = 4.0
"""Largest quantile: that of netem's tables of 16 bits."""
_CELLS = 4096
_SHAPE = 3.0
"""Shape of the Pareto distribution: netem's, from NISTnet."""

# Wichura's algorithm AS 241 for the quantiles of the normal distribution, PPND16.
_CENTRE = (
    (2509.0809287301226727, 33430.575583588128105, 67265.770927008700853, 45921.953931549871457,
     13731.693765509461125, 1971.5909503065514427, 133.14166789178437745, 3.387132872796366608),
    (5226.495278852545925, 28729.085735721942674, 39307.89580009271061, 21213.794301586595867,
     5394.1960214247511077, 687.1870074920579083, 42.313330701600911252, 1.0),
)  # fmt: skip
_TAIL = (
    (7.7454501427834140764e-4, 0.0227238449892691845833, 0.24178072517745061177,
     1.27045825245236838258, 3.64784832476320460504, 5.7694972214606914055,
     4.6303378461565452959, 1.42343711074968357734),
    (1.05075007164441684324e-9, 5.475938084995344946e-4, 0.0151986665636164571966,
     0.14810397642748007459, 0.68976733498510000455, 1.6763848301838038494,
     2.05319162663775882187, 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class ConstantDelay:
    """The same delay for every message."""

    time: NonNegative
    """[s]"""

    def __str__(self) -> str:
        return f"{1e3 * self.time:.4g} ms"

    def treat(self, message: Message) -> Treatment:
        return delay(self.time)


@dataclass(frozen=True)
class UniformDelay:
    """A delay drawn for every message, uniformly between two bounds."""

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
        return (Copy(self.low + message.draw(BASIC, 1) * (self.high - self.low)),)


@dataclass(frozen=True)
class JitteredDelay:
    """netem's `delay TIME JITTER CORRELATION distribution ...`; never below zero."""

    time: NonNegative
    """Mean [s]."""
    jitter: NonNegative
    """Scale of the distribution [s]: ± of a uniform one, σ of a normal one."""
    correlation: Annotated[float, Ge(0), Lt(1)] = 0.0
    """Correlation of the delays of consecutive messages."""
    distribution: Distribution = "uniform"

    def __str__(self) -> str:
        suffix = f", correlation {self.correlation:g}" if self.correlation else ""
        return f"{1e3 * self.time:g} ± {1e3 * self.jitter:g} ms, {self.distribution}{suffix}"

    def treat(self, message: Message) -> Treatment:
        share = message.draw(BASIC, 1, correlation=self.correlation)
        return delay(max(0.0, self.time + self.jitter * quantile(self.distribution, share)))


@dataclass(frozen=True)
class DelayFloor:
    """A least delay that grows with the distance."""

    time: NonNegative = 0.0
    """Least delay at distance 0 [s]."""
    per_metre: NonNegative = 0.0
    """[s/m]"""

    asks_distance = True

    def treat(self, message: Message) -> Treatment:
        return delay(max(0.0, self.time + self.per_metre * message.distance - message.waited))


@dataclass(frozen=True)
class Reorder:
    """netem's `reorder PERCENT gap DISTANCE`: some messages are not delayed."""

    probability: Probability = 1.0
    gap: Annotated[int, Ge(1)] = 1
    """Only every gap-th message is a candidate."""

    def treat(self, message: Message) -> Treatment:
        if (message.k + 1) % self.gap or message.waited == 0.0:
            return DELIVER
        hit = message.draw("reorder") < self.probability
        return (Copy(-message.waited),) if hit else DELIVER


@dataclass(frozen=True)
class Rate:
    """netem's `rate` and `limit`: a queue that transmits one message after the other.

    The only rule with a memory: the time at which the message before was transmitted. A receiver
    computes a link's messages in the order of their numbers, so the result is still deterministic.
    """

    bits_per_second: Positive
    size: Positive = 128.0
    """Size of every message, headers included [bytes]."""
    limit: Annotated[int, Ge(1)] = 1000
    """Most messages in the queue, with the one in transmission; a full queue drops new ones."""

    @property
    def takes(self) -> float:
        """Time to transmit one message [s]."""
        return 8.0 * self.size / self.bits_per_second

    @property
    def longest_wait(self) -> float:
        """Wait in a full queue [s]."""
        return (self.limit - 1 + _ROUNDING) * self.takes

    def treat(self, message: Message) -> Treatment:
        begins = max(message.t, message.previous)
        # A longer wait means that `limit` messages are before it, with the one in transmission.
        if begins - message.t > self.longest_wait:
            return DROP
        return delay(begins + self.takes - message.t)


@dataclass(frozen=True)
class Slot:
    """netem's `slot`: messages are delivered together at the end of each slot."""

    every: Positive
    """[s]"""

    def treat(self, message: Message) -> Treatment:
        slots = message.t / self.every
        if not math.isfinite(slots):
            # A lie about the time of sending may be too large for any slot's number.
            return DELIVER
        return delay(max(0.0, math.ceil(slots) * self.every - message.t))


def quantile(distribution: Distribution, u: float) -> float:
    """Return the value that a share u in [0, 1) of all values lies below."""
    if distribution == "uniform":
        return 2.0 * u - 1.0
    position = u * _CELLS
    cell = int(position)
    table = quantile_table(distribution)
    low, high = float(table[cell]), float(table[cell + 1])
    return low + (position - cell) * (high - low)


@cache
def quantile_table(distribution: Distribution) -> Array:
    """Return the quantiles at 0, 1/4096, ..., 1, shape (4097,)."""
    shares = np.arange(_CELLS + 1) / _CELLS
    normal = np.clip(_normal(shares), -LONGEST, LONGEST)
    if distribution == "normal":
        return normal
    pareto = np.minimum(_pareto(1.0 - shares), LONGEST)
    # A quarter normal and three quarters Pareto of the same draw, as in iproute2's table.
    return pareto if distribution == "pareto" else 0.25 * normal + 0.75 * pareto


def _normal(shares: Array) -> Array:
    """Return Φ⁻¹ at these shares."""
    q = shares - 0.5
    near = 0.180625 - q * q
    centre = q * _ratio(_CENTRE, near)
    # The table needs no tail thinner than 1/4096, and this branch covers that.
    tail = np.maximum(np.minimum(shares, 1.0 - shares), 0.25 / _CELLS)
    r = np.sqrt(-_log(tail)) - 1.6
    return np.where(np.abs(q) <= 0.425, centre, np.sign(q) * _ratio(_TAIL, r))


def _pareto(above: Array) -> Array:
    """Return the values that shares `above` lie above: (x - 3/2) 4/3 of a Pareto x >= 1."""
    x = np.array(exponential.exp(ca.DM(-_log(np.maximum(above, 1e-9)) / _SHAPE))).ravel()
    scaled: Array = (x - 1.5) * (4.0 / 3.0)
    return scaled


def _ratio(polynomials: tuple[tuple[float, ...], ...], x: Array) -> Array:
    top, bottom = (exponential.polynomial(p, x) for p in polynomials)
    ratio: Array = top / bottom
    return ratio


def _log(x: Array) -> Array:
    return np.array(exponential.log(ca.DM(x))).ravel()
