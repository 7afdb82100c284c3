"""Intervals, bands and bounds cover as they say, in synthetic studies whose truth is known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_studies.statistics import beta_mixture, betting, clopper_pearson, dkw_band, rate
from scipy.stats import binomtest

from tests.synthetic_studies import draws, misses, most_misses

LEVELS = st.sampled_from([0.5, 0.9, 0.95, 0.999])


@st.composite
def counted(draw, most=400):
    """A number of successes and of runs."""
    runs = draw(st.integers(0, most))
    return draw(st.integers(0, runs)), runs


@pytest.mark.parametrize("n", [1, 2, 3, 40])
def test_it_is_the_exact_interval_of_scipy(n):
    for k in range(n + 1):
        expected = binomtest(k, n).proportion_ci(0.9)
        assert clopper_pearson(k, n, 0.9) == pytest.approx((expected.low, expected.high))


@given(counted(), LEVELS)
def test_it_holds_the_observed_rate_and_mirrors_failures(k_of_n, level):
    k, n = k_of_n
    low, high = clopper_pearson(k, n, level)
    assert 0.0 <= low <= (k / n if n else 0.5) <= high <= 1.0
    assert clopper_pearson(n - k, n, level) == pytest.approx((1.0 - high, 1.0 - low))
    assert (low == 0.0) == (k == 0)
    assert (high == 1.0) == (k == n)


@given(counted(), LEVELS)
def test_a_sequences_interval_holds_the_rate_mirrors_failures_and_is_no_narrower(k_of_n, level):
    k, n = k_of_n
    low, high = beta_mixture(k, n, level)
    assert 0.0 <= low <= (k / n if n else 0.5) <= high <= 1.0
    assert beta_mixture(n - k, n, level) == pytest.approx((1.0 - high, 1.0 - low))
    assert high - low >= clopper_pearson(k, n, level).width - 1e-9


def test_arrays_have_the_intervals_of_their_elements():
    k = np.arange(11)
    low, high = clopper_pearson(k, 10)
    assert [tuple(clopper_pearson(int(each), 10)) for each in k] == list(
        zip(low, high, strict=True)
    )


@pytest.mark.parametrize(
    ("k", "n", "level", "words"),
    [
        *(
            (k, n, 0.95, "successes: expected none below 0")
            for k, n in ((-1, 3), ([1, 4], 3), (1, 0))
        ),
        *((1, 2, level, "level: expected a number between 0 and 1") for level in (0.0, 1.0, 95.0)),
    ],
)
def test_impossible_counts_and_levels_are_refused(k, n, level, words):
    with pytest.raises(ValueError, match=words):
        clopper_pearson(k, n, level)


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
    band, half = dkw_band([1.0, 0.0, 1.0, 1.0]), math.sqrt(math.log(40.0) / 8.0)
    assert list(band.values) == [0.0, 1.0, 1.0, 1.0]
    assert list(band.share) == [0.25, 1.0, 1.0, 1.0]
    assert list(band.low) == pytest.approx([0.0, *[1.0 - half] * 3])
    assert list(band.high) == pytest.approx([0.25 + half, 1.0, 1.0, 1.0])
    assert dkw_band([5.0]).share == 1.0


def test_a_band_around_nothing_is_empty():
    assert all(len(each) == 0 for each in dkw_band([]))


@pytest.mark.nightly
@pytest.mark.slow
def test_the_rate_over_a_grid_with_common_seeds_covers():
    luck, seeds = draws(40, 1, seed=8), np.tile(np.arange(40), 6)
    # Six points of a grid under each seed's luck, one point after the other.
    limits = np.linspace(0.05, 0.3, 6)
    rates = [rate((study < limits).T.ravel(), seeds) for study in luck]
    assert sum(bool(misses(r.interval, limits.mean())) for r in rates) <= most_misses()
    pooled = [clopper_pearson(round(240 * r.share), 240) for r in rates]
    assert sum(bool(misses(interval, limits.mean())) for interval in pooled) > 2 * most_misses()


HITS = [True, False, False, True]


@pytest.mark.parametrize(
    ("hits", "seeds", "expected"),
    [
        pytest.param(HITS, [5, 3, 8, 1], (0.5, clopper_pearson(2, 4), 4), id="own seeds"),
        pytest.param(HITS, [7] * 4, (0.5, clopper_pearson(2, 4), 4), id="one seed"),
        pytest.param([], [], (0.0, (0.0, 1.0), 0), id="no runs"),
        pytest.param(
            [*HITS, False, True], [9, 2, 5] * 2, (0.5, betting([1.0, 0.0, 0.5]), 6),
            id="each seed counts once",
        ),
        pytest.param(
            [True, False, True, False, True], [0, 1, 2, 0, 1], (0.5, betting([0.5] * 2), 4),
            id="a seed that some points lack is left out",
        ),
    ],
)  # fmt: skip
def test_seeds_that_are_no_runs_own_are_the_draws_of_a_rate(hits, seeds, expected):
    assert rate(hits, seeds) == expected
