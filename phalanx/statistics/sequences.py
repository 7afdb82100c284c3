"""Confidence sequences: intervals that hold at all times at once, however one looks and stops.

Count runs in the order of their index. In the order in which they end, short runs come first, and
a run that fails may be short: no statistic of such counts holds.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaln, xlog1py, xlogy

from phalanx.arrays import Array
from phalanx.statistics.rates import LEVEL, Interval, counts

_HALVINGS = 60
_PRIOR = 0.5
"""Both parameters of the mixing beta: half as wide as with 1 where a rate is near 0 or 1."""
_MOST_BET = 0.5
"""Largest share of the capital that is lost in one bet."""


def beta_mixture(successes: ArrayLike, runs: ArrayLike, level: float = LEVEL) -> Interval:
    """Return a confidence sequence's interval for a rate, after so many runs.

    The likelihood, mixed over a beta distribution of the rate and divided by that at p, is a
    martingale if p is true: it ever reaches 1 / α with probability α at most (Ville; Robbins,
    Annals of Mathematical Statistics 41, 1970). The interval holds all p at which it has not.

    Raises ValueError as clopper_pearson does.
    """
    k, n = counts(successes, runs, level)
    mixed = betaln(k + _PRIOR, n - k + _PRIOR) - betaln(_PRIOR, _PRIOR)
    least = mixed + math.log(1.0 - level)  # log-likelihood of a p that is just refuted
    middle = np.where(n > 0, k / np.maximum(n, 1), 0.5)
    low: Any = _bound(lambda p: xlogy(k, p) + xlog1py(n - k, -p) <= least, middle)
    high: Any = 1.0 - _bound(lambda q: xlogy(n - k, q) + xlog1py(k, -q) <= least, 1.0 - middle)
    return Interval(low[()], high[()])


def runs_until_width(outcomes: Sequence[bool], width: float, level: float = LEVEL) -> int | None:
    """Return the number of runs at which a rate is first known to a width; None if not yet.

    outcomes: of runs 0, 1, ... without a gap. The number does not depend on who looks when, so a
    study that stops there is the same on any machine.
    """
    k = np.cumsum(np.asarray(outcomes, dtype=bool))
    narrow = np.flatnonzero(beta_mixture(k, np.arange(1, len(k) + 1), level).width <= width)
    return int(narrow[0]) + 1 if len(narrow) else None


def betting(values: ArrayLike, level: float = LEVEL) -> Interval:
    """Return a confidence sequence's interval for the mean of values in [0, 1], shape (n,).

    A gambler who bets against m, with stakes from the past alone, gets rich only if m is not the
    mean. These are the hedged capital and plug-in stakes of Waudby-Smith and Ramdas (JRSS B 86,
    2024, theorem 3). All earlier looks count, so later values only narrow it. Of none: [0, 1].

    Raises ValueError of values outside [0, 1].
    """
    x = np.asarray(values, dtype=float)
    if not np.all((x >= 0.0) & (x <= 1.0)):
        raise ValueError("values: expected numbers between 0 and 1")
    bets = stakes(x, level)
    return Interval(_least_mean(x, bets, level), 1.0 - _least_mean(1.0 - x, bets, level))


def stakes(x: Array, level: float = LEVEL) -> Array:
    """Return the stake on each value in [0, 1], shape (n,), from those before it alone."""
    t = np.arange(1, len(x) + 1)
    mean = (0.5 + np.cumsum(x)) / (t + 1)
    variance = (0.25 + np.cumsum((x - mean) ** 2)) / (t + 1)
    before = np.concatenate([[0.25], variance])[:-1]
    found: Array = np.sqrt(2.0 * math.log(2.0 / (1.0 - level)) / (before * t * np.log(t + 1)))
    return found


def _least_mean(x: Array, bets: Array, level: float) -> float:
    """Return the least mean against which betting on larger values has not made rich."""
    rich = math.log(2.0 / (1.0 - level))

    def refuted(m: Array) -> Array:
        gains = np.minimum(bets, _MOST_BET / m) * (x - m)
        return np.asarray(np.cumsum(np.log1p(gains)).max(initial=0.0) >= rich)

    return float(_bound(refuted, np.asarray(1.0)))


def _bound(refuted: Callable[[Array], Array], middle: Array) -> Array:
    """Return the upper end of the part of [0, middle] that is refuted, rounded down."""
    low, high = np.zeros_like(middle), np.asarray(middle, dtype=float)
    for _ in range(_HALVINGS):
        half = (low + high) / 2.0
        out = refuted(half)
        low, high = np.where(out, half, low), np.where(out, high, half)
    return low
