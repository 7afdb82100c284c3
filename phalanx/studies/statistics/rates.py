"""Intervals for a rate at a number of runs that was fixed beforehand."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaincinv

LEVEL = 0.95
"""Confidence level unless another is given."""


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

    The number of runs must not depend on their results: else use `sequences.beta_mixture`. The
    ends are quantiles of Beta(k, n - k + 1) and Beta(k + 1, n - k). Of no runs it is [0, 1].

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
