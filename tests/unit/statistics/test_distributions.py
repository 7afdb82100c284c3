"""Bands and bounds of a distribution hold for all of it at once."""

import math

import numpy as np
import pytest

from phalanx.studies.statistics.distributions import conformal_bound, dkw_band
from tests.unit.statistics.studies import draws, most_misses


@pytest.mark.parametrize("n", [10, 300])
def test_the_band_holds_the_whole_distribution(n):
    missed = 0
    for study in draws(n):
        band = dkw_band(study)  # of a uniform distribution: F(x) = x
        before = np.concatenate([[math.sqrt(math.log(40.0) / (2 * n))], band.high[:-1]])
        # Up to the next value F rises, while the band stays as it is.
        missed += bool(np.any(band.low > band.values) or np.any(before < band.values))
    assert most_misses(0.995) < missed <= most_misses()


def test_equal_values_share_one_step():
    band = dkw_band([1.0, 0.0, 1.0, 1.0])
    assert list(band.values) == [0.0, 1.0, 1.0, 1.0]
    assert list(band.share) == [0.25, 1.0, 1.0, 1.0]


def test_a_band_around_nothing_is_empty():
    assert all(len(each) == 0 for each in dkw_band([]))


@pytest.mark.parametrize(("n", "share"), [(99, 0.9), (999, 0.99)])
def test_the_conformal_bound_holds_for_the_next_value_as_often_as_it_says(n, share):
    kept = [study[-1] <= conformal_bound(study[:-1], share) for study in draws(n + 1)]
    spread = math.sqrt(share * (1.0 - share) / len(kept))
    assert abs(np.mean(kept) - share) < 4.0 * spread


def test_too_few_values_have_no_conformal_bound():
    values = np.arange(99.0)
    assert conformal_bound(values, 0.99) == 98.0
    assert math.isinf(conformal_bound(values[1:], 0.99))
    assert math.isinf(conformal_bound([], 0.5))
