"""Statements about a whole distribution, whatever its kind, from independent values of it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phalanx.studies.statistics.rates import LEVEL
from phalanx.theory.arrays import Array

_EXACT = 1e-9
"""Shares are decimal fractions: 100 times 0.99 counts as 99, whatever its last digit."""


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


def conformal_bound(values: ArrayLike, share: float) -> float:
    """Return a bound that the next value keeps with at least this probability.

    It is the order statistic ⌈(n + 1) share⌉ of n values, and needs no more than that the next one
    is exchangeable with them (Vovk, Gammerman and Shafer, Algorithmic Learning in a Random World,
    2005). Infinite if there are fewer values than share / (1 - share).
    """
    x = np.sort(np.asarray(values, dtype=float))
    place = math.ceil((len(x) + 1) * share - _EXACT)
    return float(x[place - 1]) if 0 < place <= len(x) else math.inf
