"""Comparison of A and B under common seeds: pairs of results, and one of four answers."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import bdtr

from phalanx.arrays import Array
from phalanx.seeded.draws import Draws
from phalanx.statistics.rates import LEVEL, Interval, clopper_pearson

FEWEST = 20
"""Fewer pairs of numbers have no interval: a bootstrap knows of no value that it has not seen."""
_RESAMPLES = 2000


class Answer(StrEnum):
    """The answer of a comparison."""

    A = "A is better"
    B = "B is better"
    EQUAL = "practically equal"
    INCONCLUSIVE = "inconclusive"


class Comparison(NamedTuple):
    """A comparison and its evidence."""

    answer: Answer
    difference: float
    """A's mean or rate, less B's."""
    interval: Interval
    """Of the difference."""
    pairs: int


def compare_rates(
    a: Sequence[bool], b: Sequence[bool], margin: float, level: float = LEVEL
) -> Comparison:
    """Compare how often something unwanted happened; less is better.

    The difference is (A alone - B alone) / n, its interval that of `difference_interval`; that one
    is better is the answer of an exact McNemar test.

    Args:
        a, b: the results under the same seeds, in the same order.
        margin: rates that differ by no more are practically equal.
        level: of confidence.

    Raises ValueError if the numbers of results differ, or of a negative margin.
    """
    of_a, of_b = _pairs(a, b, margin, bool)
    n = len(of_a)
    only_a, only_b = int(np.sum(of_a & ~of_b)), int(np.sum(of_b & ~of_a))
    interval = difference_interval(only_a, only_b, n, level)
    differs = mcnemar(only_a, only_b) <= 1.0 - level
    return _answered((only_a - only_b) / max(n, 1), interval, n, margin, differs)


def difference_interval(
    only_a: ArrayLike, only_b: ArrayLike, pairs: ArrayLike, level: float = LEVEL
) -> Interval:
    """Return the interval of a difference of rates from pairs; of none it is [-1, 1].

    The distances of Clopper and Pearson's ends from both rates are added as correlated errors are
    (Newcombe, Statistics in Medicine 17, 1998; Zou and Donner, the same 27, 2008). Its coverage is
    no theorem; the tests add it up exactly.
    """
    b, c, n = np.broadcast_arrays(only_a, only_b, pairs)
    of_b, of_c = (clopper_pearson(count, n, level) for count in (b, c))
    some = np.maximum(n, 1)
    minus_correlation: Any = np.sqrt(b * c / np.maximum((n - b) * (n - c), 1))

    def reach(one: Any, other: Any) -> Any:
        return np.sqrt(one**2 + other**2 + 2.0 * minus_correlation * one * other)

    low = (b - c) / some - reach(b / some - of_b.low, of_c.high - c / some)
    high = (b - c) / some + reach(of_b.high - b / some, c / some - of_c.low)
    return Interval(np.maximum(low, -1.0)[()], np.minimum(high, 1.0)[()])


def mcnemar(only_a: int, only_b: int) -> float:
    """Return the exact two-sided p-value that both happen as often (Psychometrika 12, 1947).

    only_a, only_b: the number of pairs in which it happened to one alone.
    """
    return min(1.0, 2.0 * float(bdtr(min(only_a, only_b), only_a + only_b, 0.5)))


def compare_means(
    a: Sequence[float], b: Sequence[float], margin: float, level: float = LEVEL, seed: int = 0
) -> Comparison:
    """Compare the means of a number; less is better. See compare_rates.

    The interval is a bootstrap of the paired differences. It speaks of values like those seen: of
    a rare one that no pair has, it knows nothing.
    """
    of_a, of_b = _pairs(a, b, margin, float)
    apart = of_a - of_b
    interval = mean_interval(apart, level, seed)
    differs = bool(interval.low > 0.0 or interval.high < 0.0)
    mean = float(apart.mean()) if len(apart) else 0.0
    return _answered(mean, interval, len(apart), margin, differs)


def mean_interval(values: ArrayLike, level: float = LEVEL, seed: int = 0) -> Interval:
    """Return the studentised bootstrap interval of a mean, over the first axis.

    A resample's distance from the mean is counted in its own standard errors (Hall, Annals of
    Statistics 16, 1988). The level is approximate: long tails need more values. Fewer than FEWEST
    have the whole line.
    """
    x = np.asarray(values, dtype=float)
    n = len(x)
    if n < FEWEST:
        whole: Any = np.full(x.shape[1:], np.inf)[()]
        return Interval(-whole, whole)
    mean, draws = x.mean(axis=0), Draws(seed, "bootstrap", width=n)
    t = [_studentised(x[(n * draws[r]).astype(int)], mean) for r in range(_RESAMPLES)]
    tail = (1.0 - level) / 2.0
    low, high = np.quantile(t, (tail, 1.0 - tail), axis=0)
    error = x.std(axis=0) / np.sqrt(n)
    return Interval(mean - high * error, mean - low * error)


def _studentised(resample: Array, mean: Array) -> Array:
    """Return the distance of a resample's mean from a mean, in its standard errors."""
    error = resample.std(axis=0) / np.sqrt(len(resample))
    apart = resample.mean(axis=0) - mean
    t: Array = np.divide(apart, error, out=np.zeros_like(apart), where=error > 0.0)
    return t


def _pairs(a: ArrayLike, b: ArrayLike, margin: float, kind: type) -> tuple[Any, Any]:
    of_a: Any = np.asarray(a, dtype=kind)
    of_b: Any = np.asarray(b, dtype=kind)
    if of_a.shape != of_b.shape:
        raise ValueError(f"pairs: expected as many of A as of B, got {len(of_a)} and {len(of_b)}")
    if margin < 0.0:
        raise ValueError(f"margin: expected 0 or more, got {margin:g}")
    return of_a, of_b


def _answered(
    difference: float, interval: Interval, pairs: int, margin: float, differs: bool
) -> Comparison:
    """Answer; a difference that is certain and within the margin is practically none."""
    if -margin <= interval.low and interval.high <= margin:
        answer = Answer.EQUAL
    elif differs:
        answer = Answer.A if difference < 0.0 else Answer.B
    else:
        answer = Answer.INCONCLUSIVE
    return Comparison(answer, difference, interval, pairs)
