"""Bands and bounds of a distribution hold for all of it at once."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.statistics.distributions import (
    conformal_bound,
    dkw_band,
    tolerance_bound,
    tolerance_runs,
)
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


@pytest.mark.parametrize(("n", "share"), [(299, 0.99), (100, 0.9), (59, 0.95)])
def test_the_tolerance_bound_is_exceeded_as_seldom_as_it_says(n, share):
    bounds = np.array([tolerance_bound(study, share) for study in draws(n)])
    assert (bounds < share).sum() <= most_misses()  # of a uniform distribution


def test_299_values_bound_99_percent_with_95_and_298_do_not():
    assert tolerance_runs(0.99) == 299
    assert tolerance_bound(range(299), 0.99) == 298.0
    assert tolerance_bound(range(298), 0.99) == math.inf
    assert tolerance_bound([], 0.5) == math.inf


@given(st.floats(0.01, 0.999), st.sampled_from([0.5, 0.9, 0.95, 0.99]))
def test_the_fewest_values_are_the_fewest(share, level):
    n = tolerance_runs(share, level)
    assert 1.0 - share**n >= level - 1e-12
    assert n == 1 or 1.0 - share ** (n - 1) < level + 1e-12


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=200))
def test_more_of_the_distribution_needs_a_larger_bound(values):
    bounds = [tolerance_bound(values, share) for share in (0.1, 0.5, 0.9, 0.99)]
    assert bounds == sorted(bounds)


@pytest.mark.parametrize(("share", "level"), [(1.0, 0.9), (0.0, 0.9), (0.9, 1.0)])
def test_certainty_is_refused(share, level):
    with pytest.raises(ValueError, match="share, level: expected numbers between 0 and 1"):
        tolerance_runs(share, level)


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
