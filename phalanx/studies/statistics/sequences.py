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

from phalanx.studies.statistics.rates import LEVEL, Interval, counts
from phalanx.theory.arrays import Array, Index

_HALVINGS = 40
_PRIOR = 0.5
"""Both parameters of the mixing beta: half as wide as with 1 where a rate is near 0 or 1."""
_SHARES = np.arange(1, 21) / 21
"""Shares of the capital that are bet."""


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
    """Return a confidence sequence's interval for the mean of values in [0, 1], in any order.

    A gambler starts with 1, and bets a share of the capital that values exceed m. Unless their mean
    is larger, the capital ever reaches 2 / α with probability α / 2 at most; another bets that they
    fall short. The capital is split evenly over several shares (diversified Kelly betting,
    Waudby-Smith and Ramdas, JRSS B 86, 2024). Of no values: [0, 1].

    Raises ValueError of values outside [0, 1].
    """
    x, count = np.unique(np.asarray(values, dtype=float), return_counts=True)
    if not np.all((x >= 0.0) & (x <= 1.0)):
        raise ValueError("values: expected numbers between 0 and 1")
    return Interval(_least_mean(x, count, level), 1.0 - _least_mean(1.0 - x, count, level))


def _least_mean(x: Array, count: Index, level: float) -> float:
    """Return the least mean against which betting on larger values has not made rich."""
    rich = math.log(2.0 * len(_SHARES) / (1.0 - level))

    def refuted(m: Array) -> Array:
        capitals = np.log1p(np.outer(_SHARES, x / m - 1.0)) @ count
        return np.asarray(np.logaddexp.reduce(capitals) >= rich)

    return float(_bound(refuted, np.asarray(1.0)))


def _bound(refuted: Callable[[Array], Array], middle: Array) -> Array:
    """Return the upper end of the part of [0, middle] that is refuted, rounded down."""
    low, high = np.zeros_like(middle), np.asarray(middle, dtype=float)
    for _ in range(_HALVINGS):
        half = (low + high) / 2.0
        out = refuted(half)
        low, high = np.where(out, half, low), np.where(out, high, half)
    return low
