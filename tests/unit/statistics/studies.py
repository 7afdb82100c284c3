"""Synthetic studies whose truth is known, and how many misses their intervals may have."""

import numpy as np
from scipy.stats import binom

STUDIES = 1000


def draws(*shape: int, seed: int = 0) -> np.ndarray:
    """Uniform draws for all studies, shape (STUDIES, *shape)."""
    return np.random.default_rng(seed).random((STUDIES, *shape))


def most_misses(level: float = 0.95) -> int:
    """The number of misses that an interval that covers so often exceeds once in 10 000 times."""
    return int(binom.ppf(1.0 - 1e-4, STUDIES, 1.0 - level))


def misses(interval, truth: float) -> np.ndarray:
    """True where an interval does not hold the truth."""
    low, high = interval
    return (np.asarray(low) > truth) | (np.asarray(high) < truth)
