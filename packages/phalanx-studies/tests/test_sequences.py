"""Betting bounds the mean of seeds with several rows, however often one looks."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from phalanx_studies.statistics import betting, clopper_pearson

from tests.layers import layered
from tests.synthetic_studies import draws, misses, most_misses


def seeds_of_rows(kind: str, studies: np.ndarray) -> tuple[np.ndarray, float]:
    """Shares of the rows of each seed, shape (studies, n), and their mean."""
    first, rest = studies[..., 0], studies[..., 1:]
    if kind == "one row":
        return (first < 0.1) * 1.0, 0.1
    if kind == "twelve rows that agree":
        return np.repeat(first[..., None] < 0.3, 12, axis=-1).mean(axis=-1), 0.3
    # A seed's own rate is the square of a uniform draw: 1/3 on average.
    return (rest < first[..., None] ** 2).mean(axis=-1), 1.0 / 3.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", layered(("one row", "twelve rows that agree", "twelve rows"), ("twelve rows",))
)
def test_betting_covers_the_mean_of_seeds_with_several_rows_however_one_looks(kind):
    values, mean = seeds_of_rows(kind, draws(60, 13))
    looks = [[betting(study[:n]) for n in (20, 40, 60)] for study in values]
    assert sum(any(misses(i, mean) for i in intervals) for intervals in looks) <= most_misses()
    assert np.mean([last.width for *_, last in looks]) < 0.45


def test_rows_of_a_common_seed_break_the_interval_of_independent_ones():
    values, mean = seeds_of_rows("twelve rows", draws(60, 13))
    pooled = clopper_pearson(np.rint(12 * values).sum(axis=1).astype(int), 60 * 12)
    assert misses(pooled, mean).sum() > 4 * most_misses()


@given(st.lists(st.floats(0.0, 1.0), max_size=60), st.randoms())
def test_betting_gives_a_part_of_the_scale_around_the_mean_in_any_order(values, order):
    low, high = betting(values)
    mean = np.mean(values) if values else 0.5
    assert 0.0 <= low <= mean + 1e-9
    assert mean - 1e-9 <= high <= 1.0
    shuffled = order.sample(values, len(values))
    assert betting(shuffled) == (low, high)


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=60))
def test_larger_values_move_both_ends_up_and_a_mirror_turns_them(values):
    low, high = betting(values)
    raised = betting([min(value + 0.1, 1.0) for value in values])
    assert raised.low >= low - 1e-12
    assert raised.high >= high - 1e-12
    assert betting([1.0 - value for value in values]) == pytest.approx((1.0 - high, 1.0 - low))


def test_betting_narrows_as_values_come():
    widths = [betting([0.0, 0.25, 0.5] * n).width for n in (0, 1, 10, 100, 1000)]
    assert widths == sorted(widths, reverse=True)
    assert widths[-1] < 0.05


def test_betting_on_nothing_knows_nothing_and_one_value_is_worth_half_its_odds():
    """Half the capital is bet on average: it is 40 after a 1 if 1 + (1/m - 1) / 2 = 40."""
    assert betting([]) == (0.0, 1.0)
    assert betting([1.0]) == pytest.approx((1.0 / 79.0, 1.0))


@pytest.mark.parametrize("values", [[0.5, 1.5], [-0.1], [float("nan")]])
def test_betting_refuses_values_off_the_scale(values):
    with pytest.raises(ValueError, match="values: expected numbers between 0 and 1"):
        betting(values)
