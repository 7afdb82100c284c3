"""Statistics of repeated runs: intervals that cover as they say. Nothing here knows of runs."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv, betaln, xlog1py, xlogy

from phalanx.theory.arrays import Array, Index

LEVEL = 0.95
"""Confidence level unless another is given."""
_HALVINGS = 40
_PRIOR = 0.5
"""Both parameters of the mixing beta: half as wide as with 1 where a rate is near 0 or 1."""
_SHARES = np.arange(1, 21) / 21
"""Shares of the capital that are bet."""


class Interval(NamedTuple):
    """An interval with both ends; arrays of one shape where it was asked for arrays."""

    low: float
    high: float

    @property
    def width(self) -> float:
        """The distance between its ends."""
        return self.high - self.low


def clopper_pearson(successes: ArrayLike, runs: ArrayLike, level: float = LEVEL) -> Interval:
    """Return the exact interval of Clopper and Pearson (Biometrika 26, 1934) for a rate.

    The number of runs must not depend on their results: else use `beta_mixture`. The ends are
    quantiles of Beta(k, n - k + 1) and Beta(k + 1, n - k). Of no runs it is [0, 1].

    Raises ValueError unless 0 <= successes <= runs and 0 < level < 1.
    """
    k, n = counts(successes, runs, level)
    tail = (1.0 - level) / 2.0
    low: Any = np.where(k > 0, betaincinv(np.maximum(k, 1), n - k + 1, tail), 0.0)
    high: Any = np.where(k < n, betaincinv(k + 1, np.maximum(n - k, 1), 1.0 - tail), 1.0)
    return Interval(low[()], high[()])


def counts(successes: ArrayLike, runs: ArrayLike, level: float) -> tuple[Any, Any]:
    """Return both counts as arrays of one shape. Raises ValueError as clopper_pearson does."""
    if not 0.0 < level < 1.0:
        raise ValueError(f"level: expected a number between 0 and 1, got {level:g}")
    k, n = np.broadcast_arrays(successes, runs)
    if np.any((k < 0) | (k > n)):
        raise ValueError("successes: expected none below 0, and none above the number of runs")
    return k, n


def beta_mixture(successes: ArrayLike, runs: ArrayLike, level: float = LEVEL) -> Interval:
    """Return a confidence sequence's interval for a rate, after so many runs.

    It holds after all numbers of runs at once, so one may look at each, and stop. The likelihood,
    mixed over a beta distribution of the rate and divided by that at p, is a martingale if p is
    true: it ever reaches 1 / α with probability α at most (Ville; Robbins, Annals of Mathematical
    Statistics 41, 1970). The interval holds all p at which it has not.

    Raises ValueError as clopper_pearson does.
    """
    k, n = counts(successes, runs, level)
    mixed = betaln(k + _PRIOR, n - k + _PRIOR) - betaln(_PRIOR, _PRIOR)
    least = mixed + math.log(1.0 - level)  # log-likelihood of a p that is just refuted
    middle = np.where(n > 0, k / np.maximum(n, 1), 0.5)
    low: Any = _bound(lambda p: xlogy(k, p) + xlog1py(n - k, -p) <= least, middle)
    high: Any = 1.0 - _bound(lambda q: xlogy(n - k, q) + xlog1py(k, -q) <= least, 1.0 - middle)
    return Interval(low[()], high[()])


def betting(values: ArrayLike, level: float = LEVEL) -> Interval:
    """Return an interval for the mean of values in [0, 1], in any order.

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


class Rate(NamedTuple):
    """A rate, its interval, and the number of runs that count."""

    share: float
    interval: Interval
    runs: int


def rate(hits: ArrayLike, seeds: ArrayLike, level: float = LEVEL) -> Rate:
    """Return how often something happens, by hits and seeds of runs, shapes (n,).

    Where each run has a seed of its own, or all have the same, runs are independent. Else the seeds
    are: the mean over a seed's runs is one draw, and `betting` bounds the mean of those. A seed
    that has fewer runs than others is left out, since it stands for another mixture.
    """
    happened = np.asarray(hits, dtype=float)
    _, of_seed, size = np.unique(seeds, return_inverse=True, return_counts=True)
    n = len(happened)
    if len(size) in (n, 1):
        k = int(happened.sum())
        return Rate(k / n if n else 0.0, clopper_pearson(k, n, level), n)
    means = (np.bincount(of_seed, happened) / size)[size == size.max()]
    return Rate(float(means.mean()), betting(means, level), len(means) * int(size.max()))


class Band(NamedTuple):
    """A distribution function at the values seen, with bounds that hold everywhere at once.

    Between two values each curve is constant; arrays of shape (n,).
    """

    values: Array
    """In ascending order."""
    share: Array
    """Of the values at or below each."""
    low: Array
    high: Array


def dkw_band(values: ArrayLike, level: float = LEVEL) -> Band:
    """Return the band of Dvoretzky, Kiefer and Wolfowitz around the empirical distribution.

    Half its height is sqrt(ln(2 / α) / 2n), with the constant of Massart (Annals of Probability
    18, 1990). Below the first value `low` is 0, and `high` is half the height.
    """
    x = np.sort(np.asarray(values, dtype=float))
    n = max(len(x), 1)
    share = np.searchsorted(x, x, side="right") / n
    half = math.sqrt(math.log(2.0 / (1.0 - level)) / (2.0 * n))
    return Band(x, share, np.maximum(share - half, 0.0), np.minimum(share + half, 1.0))
