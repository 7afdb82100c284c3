"""Runs of a common seed are one draw: the interval of a rate counts seeds, not runs."""

import numpy as np
import pytest

from phalanx.studies.statistics.common_seeds import rate
from phalanx.studies.statistics.rates import clopper_pearson
from phalanx.studies.statistics.sequences import beta_mixture, betting
from tests.unit.statistics.studies import draws, misses, most_misses


@pytest.mark.nightly
@pytest.mark.slow
def test_the_rate_over_a_grid_with_common_seeds_covers():
    luck, seeds = draws(40, 1, seed=8), np.tile(np.arange(40), 6)
    # Six points of a grid under each seed's luck, one point after the other.
    limits = np.linspace(0.05, 0.3, 6)
    found = [rate((study < limits).T.ravel(), seeds) for study in luck]
    assert sum(bool(misses(each.interval, limits.mean())) for each in found) <= most_misses()
    pooled = [clopper_pearson(round(240 * each.share), 240) for each in found]
    assert sum(bool(misses(each, limits.mean())) for each in pooled) > 2 * most_misses()


def test_runs_with_seeds_of_their_own_are_independent():
    hits = [True, False, False, True]
    assert rate(hits, [5, 3, 8, 1]) == (0.5, clopper_pearson(2, 4), 4)
    assert rate(hits, [5, 3, 8, 1], anytime=True) == (0.5, beta_mixture(2, 4), 4)


def test_draws_of_other_fields_under_one_seed_are_independent():
    assert rate([True, False, False, True], [7] * 4) == (0.5, clopper_pearson(2, 4), 4)


def test_no_runs_say_nothing():
    assert rate([], []) == (0.0, (0.0, 1.0), 0)


def test_each_seed_counts_once():
    hits = [True, False, False, True, False, True]
    assert rate(hits, [9, 2, 5] * 2) == (0.5, betting([1.0, 0.0, 0.5]), 6)


def test_a_seed_that_some_points_lack_is_left_out():
    hits, seeds = [True, False, True, False, True], [0, 1, 2, 0, 1]
    assert rate(hits, seeds) == (0.5, betting([0.5, 0.5]), 4)
