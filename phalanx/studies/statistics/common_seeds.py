"""A rate over runs that share seeds: those of one seed have the same luck, and are no two draws."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from phalanx.studies.statistics.rates import LEVEL, Interval, clopper_pearson
from phalanx.studies.statistics.sequences import beta_mixture, betting


class Rate(NamedTuple):
    """A rate, its interval, and the number of runs that count."""

    share: float
    interval: Interval
    runs: int


def rate(hits: ArrayLike, seeds: ArrayLike, anytime: bool = False, level: float = LEVEL) -> Rate:
    """Return how often something happens, by hits and seeds of runs, shapes (n,).

    Where each run has a seed of its own, or all have the same, runs are independent. Else the seeds
    are: the mean over a seed's runs is one draw, and `betting` bounds the mean of those. A seed
    that has fewer runs than others is left out, since it stands for another mixture.

    anytime: whether the number of runs depends on their results. level: of confidence.
    """
    happened = np.asarray(hits, dtype=float)
    _, of_seed, size = np.unique(seeds, return_inverse=True, return_counts=True)
    n = len(happened)
    if len(size) in (n, 1):
        k = int(happened.sum())
        interval = (beta_mixture if anytime else clopper_pearson)(k, n, level)
        return Rate(k / n if n else 0.0, interval, n)
    means = (np.bincount(of_seed, happened) / size)[size == size.max()]
    return Rate(float(means.mean()), betting(means, level), len(means) * int(size.max()))
