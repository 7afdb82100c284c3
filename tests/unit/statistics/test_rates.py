"""An interval for a rate covers as it says, at the ends of the scale too."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from phalanx.studies.statistics.rates import clopper_pearson
from tests.unit.statistics.studies import draws, misses, most_misses

LEVELS = st.sampled_from([0.5, 0.9, 0.95, 0.999])


@st.composite
def counted(draw, most=400):
    """A number of successes and of runs."""
    runs = draw(st.integers(0, most))
    return draw(st.integers(0, runs)), runs


@pytest.mark.parametrize("rate", [0.0, 0.002, 0.03, 0.3, 0.5, 0.97, 1.0])
@pytest.mark.parametrize("runs", [5, 100, 1000])
def test_the_interval_covers_at_a_fixed_number_of_runs(rate, runs):
    successes = (draws(runs) < rate).sum(axis=1)
    assert misses(clopper_pearson(successes, runs), rate).sum() <= most_misses()


@given(counted(), LEVELS)
def test_it_is_the_exact_interval_of_scipy(k_of_n, level):
    k, n = k_of_n
    if n:
        expected = binomtest(k, n).proportion_ci(level)
        assert clopper_pearson(k, n, level) == pytest.approx((expected.low, expected.high))


@given(counted(), LEVELS)
def test_it_holds_the_observed_rate_and_mirrors_failures(k_of_n, level):
    k, n = k_of_n
    low, high = clopper_pearson(k, n, level)
    assert 0.0 <= low <= (k / n if n else 0.5) <= high <= 1.0
    assert clopper_pearson(n - k, n, level) == pytest.approx((1.0 - high, 1.0 - low))
    assert (low == 0.0) == (k == 0)
    assert (high == 1.0) == (k == n)


@given(counted(), LEVELS)
def test_one_more_success_moves_both_ends_up(k_of_n, level):
    k, n = k_of_n
    fewer, more = clopper_pearson(k, n + 1, level), clopper_pearson(k + 1, n + 1, level)
    assert fewer.low < more.low
    assert fewer.high < more.high


@given(counted(most=50).filter(lambda each: each[1] > 0))
def test_a_higher_level_and_fewer_runs_are_wider(k_of_n):
    k, n = k_of_n
    width = clopper_pearson(k, n).width
    assert clopper_pearson(k, n, 0.99).width > width
    assert clopper_pearson(2 * k, 2 * n).width < width


def test_arrays_have_the_intervals_of_their_elements():
    k = np.arange(11)
    low, high = clopper_pearson(k, 10)
    assert [tuple(clopper_pearson(int(each), 10)) for each in k] == list(
        zip(low, high, strict=True)
    )


@pytest.mark.parametrize(("k", "n"), [(-1, 3), (4, 3), (1, 0)])
def test_impossible_counts_are_refused(k, n):
    with pytest.raises(ValueError, match="successes: expected none below 0"):
        clopper_pearson(k, n)


@pytest.mark.parametrize("level", [0.0, 1.0, 95.0])
def test_a_level_that_is_no_share_is_refused(level):
    with pytest.raises(ValueError, match="level: expected a number between 0 and 1"):
        clopper_pearson(1, 2, level)
