"""Probabilities of rare events by adaptive multilevel splitting.

Paths that come no nearer to the event than the others are stopped. In their place others branch
where they first came nearer, and go on with new randomness (Cérou and Guyader, Stochastic Analysis
and Applications 25, 2007). Each estimate is unbiased, for any score and any number of paths
(Bréhier, Gazeau, Goudenège, Lelièvre and Rousset, Annals of Applied Probability 26, 2016).
"""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from scipy.special import stdtrit

from phalanx.arrays import Array
from phalanx.seeded.draws import Draws
from phalanx.statistics.rates import LEVEL, Interval, clopper_pearson


class Path(Protocol):
    """One path of a random process from its beginning to its end."""

    @property
    def peak(self) -> float:
        """The largest score on the path: the larger, the nearer it came to the event."""

    def branch(self, level: float, seed: int) -> Self:
        """Return a path that is the same until its score first exceeds a level.

        From then on its randomness is drawn again, by this seed. The score at a time must depend
        on what was drawn before alone.
        """


P = TypeVar("P", bound=Path)
Executes = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""As the built-in map, perhaps on several processes; results come in order."""


class Splitting(NamedTuple):
    """An unbiased estimate of the probability that a score exceeds a level."""

    probability: float
    runs: int
    """Paths begun or branched."""
    first: tuple[int, int]
    """Of the independent paths at first: those that exceeded the level, and their number."""

    @property
    def least_error(self) -> float:
        """Standard error relative to the probability, were the score the best there is.

        It is sqrt(-ln p / n) (Guyader, Hengartner and Matzner-Løber, Applied Mathematics and
        Optimization 64, 2011). With another score it is larger: see `combined`.
        """
        p = self.probability
        return math.sqrt(-math.log(p) / self.first[1]) if p > 0.0 else math.inf


class RareEvent(NamedTuple):
    """The mean of several independent estimates."""

    probability: float
    interval: Interval
    error: float
    """Estimated standard error of the probability."""
    runs: int
    """Paths of all estimates."""

    @property
    def plain_runs(self) -> float:
        """Number of runs after which plain counting has the same standard error."""
        p = self.probability
        return p * (1.0 - p) / self.error**2 if self.error > 0.0 else math.inf


def split(
    begin: Callable[[int], P],
    level: float,
    *,
    paths: int = 100,
    stopped: int = 1,
    seed: int = 0,
    executes: Executes = map,
) -> Splitting:
    """Estimate the probability that a path's score exceeds a level.

    Args:
        begin: makes an independent path by its seed.
        level: of the event.
        paths: their number at each time, n.
        stopped: least number of paths that are replaced at once, below n: those can be computed
            in parallel.
        seed: of all choices, and of the paths' seeds.
        executes: computes paths.

    Raises ValueError unless 0 < stopped < paths.
    """
    if not 0 < stopped < paths:
        raise ValueError(f"stopped: expected 1 to {paths - 1}, got {stopped}")
    draws, runs, weight = Draws(seed, "splitting", width=2), paths, 1.0
    alive = list(executes(begin, [_seed(draws, k) for k in range(paths)]))
    peaks = np.array([path.peak for path in alive])
    first = int((peaks > level).sum()), paths
    while (reached := float(np.sort(peaks)[stopped - 1])) <= level:
        last, ahead = np.flatnonzero(peaks <= reached), np.flatnonzero(peaks > reached)
        weight *= len(ahead) / paths
        if not len(ahead):
            break
        numbers = range(runs, runs + len(last))
        parents = [alive[ahead[int(draws.value(k, 1) * len(ahead))]] for k in numbers]
        asked = [(p, reached, _seed(draws, k)) for p, k in zip(parents, numbers, strict=True)]
        for place, path in zip(last, executes(_branched, asked), strict=True):
            alive[place], peaks[place] = path, path.peak
        runs += len(last)
    return Splitting(weight * float((peaks > level).mean()), runs, first)


def combined(estimates: Sequence[Splitting], level: float = LEVEL) -> RareEvent:
    """Combine independent estimates of one probability, of two or more seeds.

    The interval is Student's. If every estimate is zero it is that of the first, independent paths
    alone, by Clopper and Pearson.
    """
    found: Array = np.array([each.probability for each in estimates])
    mean, runs = float(found.mean()), sum(each.runs for each in estimates)
    error = float(found.std(ddof=1)) / math.sqrt(len(found))
    if mean == 0.0:
        hits, begun = (sum(each.first[n] for each in estimates) for n in (0, 1))
        return RareEvent(0.0, clopper_pearson(hits, begun, level), 0.0, runs)
    half = error * float(stdtrit(len(found) - 1, 0.5 + level / 2.0))
    return RareEvent(mean, Interval(max(mean - half, 0.0), min(mean + half, 1.0)), error, runs)


def _branched(asked: tuple[P, float, int]) -> P:
    path, level, seed = asked
    return path.branch(level, seed)


def _seed(draws: Draws, k: int) -> int:
    return int(draws.value(k) * 2.0**53)
