"""Time series thinned to what a plot can show, keeping what it must not hide."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from phalanx.arrays import Array
from phalanx_viewer.plots.content import Curve

Keep = Callable[[Array], NDArray[np.intp]]
"""Of blocks of values, shape (c, s), which one of each a thinned curve goes through, shape (c,)."""

MOST_POINTS, LEAST_POINTS = 400, 60
"""Of one curve."""
_POINTS_OF_ALL = 3000
"""Of one quantity's curves, if there are many agents."""
_ENVELOPE_POINTS = 100


class Series(NamedTuple):
    """Values at times [s]; NaN where there is none."""

    t: Array
    y: Array

    def known(self) -> "Series":
        """Without those that are not known."""
        found = np.isfinite(self.y)
        return Series(self.t[found], self.y[found])


def highest(y: Array) -> NDArray[np.intp]:
    """The largest of each block."""
    return np.asarray(y.argmax(axis=1))


def lowest(y: Array) -> NDArray[np.intp]:
    """The smallest of each block."""
    return np.asarray(y.argmin(axis=1))


def farthest(y: Array) -> NDArray[np.intp]:
    """Of each block the value that is farthest from the others."""
    return np.asarray(np.abs(y - y.mean(axis=1, keepdims=True)).argmax(axis=1))


def points_each(curves: int) -> int:
    """How many points so many curves of one plot may have, each."""
    return int(np.clip(_POINTS_OF_ALL // max(curves, 1), LEAST_POINTS, MOST_POINTS))


def curve(
    series: Series, keep: Keep, name: str = "", *,
    agent: int | None = None, role: str = "", most: int = MOST_POINTS,
) -> Curve:  # fmt: skip
    """A series as a curve through one value of each block of its steps."""
    t, y = series.known()
    if len(t) > most:
        size = -(-len(t) // most)
        blocks = np.pad(y, (0, -len(y) % size), mode="edge").reshape(-1, size)
        kept = np.minimum(np.arange(0, len(t), size) + keep(blocks), len(t) - 1)
        t, y = t[kept], y[kept]
    return Curve(numbers(t, 7), numbers(y, 4), name=name, agent=agent, role=role)


def envelope(of_all: Sequence[Series]) -> list[Curve]:
    """Of many agents: the bands of all and of 10 to 90 %, and the median."""
    known = [series for each in of_all if len((series := each.known()).t)]
    if not known:
        return []
    t = np.linspace(min(s.t[0] for s in known), max(s.t[-1] for s in known), _ENVELOPE_POINTS)
    at = [np.searchsorted(s.t, t, side="right") - 1 for s in known]
    y = np.array([np.where(k < 0, np.nan, s.y[k]) for k, s in zip(at, known, strict=True)])
    edges = np.nanpercentile(y, [0, 10, 50, 90, 100], axis=0)
    least, low, middle, high, most = (numbers(edge, 4) for edge in edges)
    times = numbers(t, 7)
    return [
        Curve(times, least, most, "all agents"),
        Curve(times, low, high, "10 to 90 %"),
        Curve(times, middle, name="median"),
    ]


def numbers(values: Array, digits: int) -> list[float]:
    """Rounded to so many significant digits: a plot shows no more, and the page loads sooner."""
    with np.errstate(divide="ignore"):
        size = np.floor(np.log10(np.abs(values)))
    unit = 10.0 ** (np.where(np.isfinite(size), size, 0.0) - digits + 1)
    rounded: list[float] = (np.round(values / unit) * unit).round(12).tolist()
    return rounded
