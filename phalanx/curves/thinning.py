"""Time series, thinned to what can be seen, and the envelope of many."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index

QUANTILES = (0.0, 0.1, 0.5, 0.9, 1.0)
_MOST_POINTS = 1600
_MOST_INTERVALS = 300
"""More than can be distinguished in a figure."""


class Series(NamedTuple):
    """Values at times [s], shapes (s,); NaN where there is none."""

    t: Array
    y: Array

    def known(self) -> "Series":
        """The values that are not NaN."""
        found = np.isfinite(self.y)
        return Series(self.t[found], self.y[found])


def kept(y: Array, most: int = _MOST_POINTS, *, highest: bool = True, lowest: bool = True) -> Index:
    """Choose the values, by index, through which y, shape (s,), is drawn.

    Args:
        y: values; NaN is a gap.
        most: number of values kept.
        highest: whether the largest value of every block is kept, so that each peak is seen.
        lowest: likewise the smallest.
    """
    if len(y) <= most:
        return np.arange(len(y))
    size = -(-len(y) // ((most - 2) // (highest + lowest)))
    places = np.minimum(np.arange(-(-len(y) // size) * size), len(y) - 1).reshape(-1, size)
    values, rows = y[places], np.arange(len(places))
    found = [np.array([0, len(y) - 1])]
    if highest:
        found.append(places[rows, np.where(np.isnan(values), -np.inf, values).argmax(axis=1)])
    if lowest:
        found.append(places[rows, np.where(np.isnan(values), np.inf, values).argmin(axis=1)])
    return np.unique(np.concatenate(found))


class Envelope(NamedTuple):
    """Quantiles of all values in each interval of time; an interval without values is left out."""

    edges: Array
    """Where the intervals begin and end [s], shape (b, 2)."""
    values: Array
    """By QUANTILES, shape (5, b); each is one of the values, not interpolated."""


def envelope(curves: Sequence[Series], most: int = _MOST_INTERVALS) -> Envelope:
    """Compute the envelope of many curves in at most `most` intervals.

    An interval holds two values of each curve, about: with one, clocks that jitter would leave a
    curve out of some.
    """
    t, values = (np.concatenate(c) for c in zip(*(s.known() for s in curves), strict=True))
    if not len(t):
        return Envelope(np.zeros((0, 2)), np.zeros((len(QUANTILES), 0)))
    intervals = max(1, min(int(np.median([len(s.t) for s in curves])) // 2, most))
    edges = np.linspace(t.min(), t.max(), intervals + 1)
    at = (intervals / max(np.ptp(t), 1e-9) * (t - t.min())).astype(np.int16)
    interval = np.minimum(at, intervals - 1)
    # Of small integers a stable sort is a radix sort, and a few ranks need no sorted values.
    order = np.argsort(interval, kind="stable")
    found, begin = np.unique(interval[order], return_index=True)
    each = [_ranked(of_interval) for of_interval in np.split(values[order], begin[1:])]
    return Envelope(np.stack([edges[found], edges[found + 1]], axis=1), np.array(each).T)


def _ranked(values: Array) -> Array:
    """Select the values nearest to QUANTILES."""
    ranks = np.round(np.array(QUANTILES) * (len(values) - 1)).astype(int)
    ranked: Array = np.partition(values, ranks)[ranks]
    return ranked
