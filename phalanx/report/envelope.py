"""What many curves have in common: least, median, a band of quantiles and largest, over time."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from phalanx.arrays import Array

QUANTILES = (0.0, 0.1, 0.5, 0.9, 1.0)
_MOST_INTERVALS = 300
"""More than the eye tells apart in a figure."""


class Envelope(NamedTuple):
    """Quantiles of all values in each interval of time; an interval without values is left out."""

    edges: Array
    """Where the intervals begin and end [s], shape (b, 2)."""
    values: Array
    """By QUANTILES, shape (5, b); each is a value that there is."""


def envelope(t: Array, values: Array, each: int) -> Envelope:
    """The envelope of many curves.

    Args:
        t: times of the values of all curves, in any order [s], shape (v,).
        values: shape (v,); NaN counts as none.
        each: how many values a curve has, about. An interval holds two of each: with one, clocks
            that jitter would leave a curve out of some.
    """
    known = ~np.isnan(values)
    t, values = t[known], values[known]
    if not len(t):
        return Envelope(np.zeros((0, 2)), np.zeros((len(QUANTILES), 0)))
    intervals = max(1, min(each // 2, _MOST_INTERVALS))
    edges = np.linspace(t.min(), t.max(), intervals + 1)
    interval = np.clip(np.searchsorted(edges, t, side="right") - 1, 0, intervals - 1)
    order = np.lexsort((values, interval))
    found, begin, count = np.unique(interval[order], return_index=True, return_counts=True)
    ranks = np.round(np.outer(QUANTILES, count - 1)).astype(int)
    return Envelope(
        np.stack([edges[found], edges[found + 1]], axis=1), values[order][begin + ranks]
    )


def draw_envelope(axes: Axes, found: Envelope, colour: str, of: str) -> None:
    """Draw it as two bands, pale from least to largest, and the median as a line."""
    t = found.edges.ravel()
    least, low, middle, high, largest = np.repeat(found.values, 2, axis=1)
    bands = (least, largest, 0.15, "least to largest"), (low, high, 0.3, "10 to 90 %")
    for below, above, alpha, words in bands:
        label = f"{of}: {words}"
        axes.fill_between(t, below, above, color=colour, alpha=alpha, linewidth=0.0, label=label)
    axes.plot(t, middle, color=colour, linewidth=1.4, label=f"{of}: median")
