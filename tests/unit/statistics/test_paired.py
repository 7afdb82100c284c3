"""A comparison under common seeds: A is better, B is, they are practically equal, or it is open."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest, multinomial

from phalanx.statistics.paired import (
    FEWEST,
    Answer,
    compare_means,
    compare_rates,
    difference_interval,
    mcnemar,
    mean_interval,
)
from tests.unit.statistics.studies import STUDIES, draws, misses, most_misses


def bits(only_a: int, only_b: int, both: int = 0, neither: int = 0) -> tuple[list, list]:
    """Results of A and of B with these numbers of pairs."""
    counts = ((1, 0), only_a), ((0, 1), only_b), ((1, 1), both), ((0, 0), neither)
    pairs = [pair for pair, count in counts for _ in range(count)]
    return [bool(a) for a, _ in pairs], [bool(b) for _, b in pairs]


@pytest.mark.parametrize(
    ("only_a", "only_b", "neither", "answer"),
    [
        (0, 12, 100, Answer.A),
        (12, 0, 100, Answer.B),
        (3, 2, 100, Answer.INCONCLUSIVE),
        (3, 2, 5000, Answer.EQUAL),
        (0, 0, 3, Answer.INCONCLUSIVE),
        (0, 0, 0, Answer.INCONCLUSIVE),
        (0, 9, 50_000, Answer.EQUAL),
    ],
)
def test_rates_get_one_of_four_answers(only_a, only_b, neither, answer):
    assert compare_rates(*bits(only_a, only_b, neither=neither), margin=0.01).answer is answer


def test_pairs_that_agree_do_not_count_for_the_test():
    assert mcnemar(2, 11) == pytest.approx(binomtest(2, 13).pvalue)
    alone = compare_rates(*bits(2, 11), margin=0.0).answer
    assert compare_rates(*bits(2, 11, both=500), margin=0.0).answer is alone is Answer.A


@given(st.integers(0, 300), st.integers(0, 300))
def test_the_test_is_symmetric_and_exact(b, c):
    assert mcnemar(b, c) == mcnemar(c, b)
    assert mcnemar(b, c) == pytest.approx(binomtest(b, b + c).pvalue if b + c else 1.0)


@given(st.integers(0, 40), st.integers(0, 40), st.integers(0, 40))
def test_exchanged_the_two_have_the_opposite_answer(only_a, only_b, neither):
    a, b = bits(only_a, only_b, neither=neither)
    one, other = compare_rates(a, b, margin=0.05), compare_rates(b, a, margin=0.05)
    opposite = {Answer.A: Answer.B, Answer.B: Answer.A}
    assert other.answer is opposite.get(one.answer, one.answer)
    assert other.difference == -one.difference
    assert other.interval == pytest.approx((-one.interval.high, -one.interval.low))


@pytest.mark.parametrize("n", [10, 30, 100])
def test_the_interval_of_two_rates_covers_by_the_sum_over_all_results(n):
    b, c = (
        each[np.add.outer(range(n + 1), range(n + 1)) <= n] for each in np.indices((n + 1,) * 2)
    )
    low, high = difference_interval(b, c, n)
    covered = []
    rates = 0.0, 0.005, 0.02, 0.1, 0.2, 0.3, 0.4, 0.7, 0.9
    for of_a, of_b in [(p, q) for p in rates for q in rates if p + q <= 1.0]:
        share = multinomial.pmf(np.stack([b, c, n - b - c], 1), n, [of_a, of_b, 1 - of_a - of_b])
        holds = (low <= of_a - of_b + 1e-12) & (of_a - of_b - 1e-12 <= high)
        covered.append(share[holds].sum())
    assert 0.949 < min(covered) < 0.965


def test_no_pairs_say_nothing_about_a_difference():
    assert difference_interval(0, 0, 0) == (-1.0, 1.0)


@pytest.mark.parametrize(("of_a", "of_b"), [(0.1, 0.1), (0.3, 0.1), (0.02, 0.0)])
def test_the_answer_is_seldom_wrong(of_a, of_b):
    u = draws(150, 3)
    luck = np.where(u[..., :1] < 0.5, u[..., :1] * 2, u[..., 1:])  # common to half of the pairs
    runs = zip(luck[..., 0] < of_a, luck[..., 1] < of_b, strict=True)
    found = [compare_rates(a, b, 0.0) for a, b in runs]
    assert sum(bool(misses(each.interval, of_a - of_b)) for each in found) <= most_misses()
    right = Answer.INCONCLUSIVE if of_a == of_b else Answer.B
    wrong = [each for each in found if each.answer not in (right, Answer.INCONCLUSIVE)]
    assert len(wrong) <= most_misses()


@pytest.mark.parametrize("kind", ["normal", "uniform", "exponential"])
def test_the_bootstrap_covers_the_mean_of_differences(kind):
    rng = np.random.default_rng(5)
    makes = {
        "normal": (lambda size: rng.normal(0.0, 1.0, size), 0.0),
        "uniform": (lambda size: rng.random(size), 0.5),
        "exponential": (lambda size: rng.exponential(1.0, size), 1.0),
    }
    draw, mean = makes[kind]
    interval = mean_interval(draw((50, STUDIES)))
    assert misses(interval, mean).sum() <= most_misses()
    assert misses(interval, mean).sum() > most_misses(0.99)


def test_a_mean_gets_one_of_four_answers():
    rng = np.random.default_rng(1)
    common, noise = rng.normal(0.0, 10.0, 200), rng.normal(0.0, 0.1, 200)
    compared = {
        shift: compare_means(common, common + noise + shift, margin=0.05).answer
        for shift in (-0.5, 0.0, 0.5)
    }
    assert compared == {-0.5: Answer.B, 0.0: Answer.EQUAL, 0.5: Answer.A}
    # Without common luck the same difference drowns.
    assert compare_means(common, common[::-1] + 0.5, 0.05).answer is Answer.INCONCLUSIVE


def test_the_bootstrap_depends_on_the_seed_and_on_nothing_else():
    values = np.random.default_rng(0).exponential(1.0, 40)
    assert mean_interval(values) == mean_interval(values)
    assert mean_interval(values) != mean_interval(values, seed=1)
    both = mean_interval(np.column_stack([values, 2.0 * values]))
    assert (both.low[0], both.high[0]) == pytest.approx(mean_interval(values))


def test_few_pairs_and_none_are_inconclusive():
    for n in (0, 1, FEWEST - 1):
        assert compare_means([0.0] * n, [1.0] * n, 0.1).answer is Answer.INCONCLUSIVE
    assert compare_means([0.0] * FEWEST, [1.0] * FEWEST, 0.1).answer is Answer.A
    assert compare_means([1.0] * FEWEST, [1.0] * FEWEST, 0.1).answer is Answer.EQUAL


def test_results_without_a_partner_and_a_negative_margin_are_refused():
    with pytest.raises(ValueError, match="pairs: expected as many of A as of B, got 2 and 1"):
        compare_rates([True, False], [True], 0.1)
    with pytest.raises(ValueError, match="margin: expected 0 or more, got -1"):
        compare_means([1.0], [1.0], -1.0)
