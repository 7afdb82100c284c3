"""Pair truth: when which pair left the safe set, how far and how long."""

from collections.abc import Sequence

import numpy as np
import pytest
from phalanx_plant.world.evaluation import EvaluatedSteps
from phalanx_plant.world.extremes import Crossing, PairExtremes

from phalanx.theory.safety.composition import ComposedSet
from tests.unit.swarms import swarm_of_scenario


def pairs() -> ComposedSet:
    return swarm_of_scenario("unicycles").safe_set


def show(
    truth: PairExtremes, times: list[float], **h: list[float]
) -> tuple[float, list[tuple[float, str, bool]]]:
    """Show a history: the pairs' h by label ("1-2" as p1_2), all others -50.

    Returns the largest h_tot, and the pairs that left or came back.
    """
    table = np.full((len(times), len(labels())), -50.0)
    for name, values in h.items():
        table[:, labels().index(name[1:].replace("_", "-"))] = values
    extremes = truth.add([steps(times, table, table.max(axis=1) + 0.01)], 1)
    crossings = [(t, truth.label(pair), unsafe) for _, (t, pair, unsafe) in extremes.crossings]
    return extremes.peak(0)[0], crossings


def steps(
    times: list[float], h: np.ndarray, h_tot: np.ndarray, numbers: Sequence[int] = ()
) -> EvaluatedSteps:
    """Steps with the h of all pairs, of history 0 or of histories by number."""
    of, every = np.array(numbers or [0] * len(times)), np.arange(len(labels()))
    return EvaluatedSteps(of, np.array(times), every, h, h_tot, np.zeros(0), of >= 0)


def test_a_violation_has_its_pair_its_beginning_its_depth_and_its_length():
    truth = PairExtremes(pairs())
    show(truth, [0.1, 0.2, 0.3], p1_2=[-1.0, -0.5, 0.5])
    show(truth, [0.4, 0.6], p1_2=[2.0, -0.1], p3_5=[-3.0, 0.25])
    show(truth, [0.7, 0.8], p1_2=[-0.2, 0.1], p3_5=[0.5, -1.0])
    deeper, shallower = truth.violations()
    assert (deeper.pair, shallower.pair) == ("1-2", "3-5")
    assert (deeper.first, deeper.worst, deeper.worst_at) == (0.3, 2.0, 0.4)
    assert deeper.duration == pytest.approx(0.6 - 0.3)
    assert (shallower.first, shallower.worst, shallower.worst_at) == (0.6, 0.5, 0.7)
    assert shallower.duration == pytest.approx(0.8 - 0.6)
    assert (truth.worst_h, truth.worst_at, truth.worst_pair) == (2.0, 0.4, "1-2")
    assert truth.largest_h_tot == pytest.approx(2.01)


def test_each_excursion_of_a_pair_has_its_own_begin_and_end():
    truth = PairExtremes(pairs())
    crossings = []
    for times, h in (
        ([0.1, 0.2, 0.3, 0.4], [0.5, -0.1, -0.1, 0.2]),
        ([0.5, 0.6], [-1.0, -1.0]),
        ([0.7, 0.8], [-1.0, 0.1]),
    ):
        crossings += show(truth, times, p1_2=h)[1]
    assert crossings == [
        (t, "1-2", unsafe)
        for t, unsafe in ((0.1, True), (0.2, False), (0.4, True), (0.5, False), (0.8, True))
    ]
    (violation,) = truth.violations()
    assert (violation.count, violation.first, violation.begin, violation.end) == (3, 0.1, 0.8, None)
    show(truth, [0.9], p1_2=[0.05])
    (violation,) = truth.violations()
    assert violation.duration == pytest.approx(0.1 + 0.1 + 0.1), "it lasts until now"
    assert violation.times == "0.300 s from t = 0.100 s on, in 3 excursions"
    show(truth, [1.0], p1_2=[-0.1])
    (violation,) = truth.violations()
    assert (violation.end, violation.times[-27:]) == (1.0, "to 1.000 s, in 3 excursions")


def test_the_worst_h_is_of_the_worst_pair_and_not_where_h_tot_is_largest():
    """Many pairs that are nearly unsafe make a larger h_tot than one that is."""
    truth = PairExtremes(pairs())
    show(truth, [0.1], p1_2=[0.3])
    nearly = steps([0.2], np.full((1, len(labels())), -0.001), np.array([0.9]))
    assert truth.add([nearly], 1).peak(0) == (0.9, 0.3)
    assert (truth.worst_h, truth.worst_at, truth.worst_pair) == (0.3, 0.1, "1-2")
    assert (truth.largest_h_tot, truth.largest_h_tot_at) == (0.9, 0.2)


def test_histories_at_once_have_the_extremes_of_each_alone(rng):
    """Some have no step, pairs come near and get away, and not all of them are looked at."""
    together, alone = PairExtremes(pairs()), PairExtremes(pairs())
    for excluded in (np.zeros(0, dtype=int), np.array([2, 3])):
        for truth in (together, alone):
            truth.exclude(excluded, 0.0)
        blocks, first = [], 0
        for size in rng.integers(1, 40, 3):
            numbers = np.sort(first + rng.integers(0, 9, size))
            h = np.round(rng.normal(-1.0, 0.7, (size, 6)), 1)
            chosen = np.sort(rng.choice(len(labels()), 6, replace=False))
            times = 0.1 * (first + np.arange(size))
            block = steps(times.tolist(), h, np.round(h.max(axis=1) + 0.05, 1), numbers.tolist())
            blocks.append(block._replace(pairs=chosen))
            first = int(numbers[-1]) + 1
        extremes = together.add(blocks, first + 2)
        for number in range(first + 2):
            parts = [
                EvaluatedSteps(0 * b.numbers[m], b.times[m], b.pairs, b.h[m], b.h_tot[m], *b[5:])
                for b in blocks
                if (m := b.numbers == number).any()
            ]
            one = alone.add(parts, 1)
            assert one.peak(0) == extremes.peak(number)
            assert one.pairs[0] == extremes.pairs[number]
            assert [c for _, c in one.crossings] == [
                c for n, c in extremes.crossings if n == number
            ]
        assert together.violations() == alone.violations() != []
        assert together.excluded() == alone.excluded()
        assert (together.worst_h, together.worst_at) == (alone.worst_h, alone.worst_at)
        assert together.largest_h_tot_at == alone.largest_h_tot_at


def test_h_at_exactly_zero_is_safe():
    truth = PairExtremes(pairs())
    _, crossings = show(truth, [0.1, 0.2], p1_2=[0.0, -0.1])
    assert truth.violations() == []
    assert crossings == []


def test_lse_above_zero_is_no_departure_while_every_pair_is_at_most_zero():
    truth = PairExtremes(pairs())
    crossings = []
    for t, h in ((0.1, -0.005), (0.2, 0.1), (0.3, -1.0)):
        crossings += show(truth, [t], p1_2=[h])[1]
    assert truth.largest_h_tot > 0.0
    assert crossings == [(0.2, "1-2", True), (0.3, "1-2", False)]


def test_an_h_that_is_not_a_number_is_not_safe():
    """NaN > 0 is false, but so is NaN <= 0, and safe is h <= 0."""
    truth = PairExtremes(pairs())
    show(truth, [0.1, 0.2], p1_2=[-1.0, float("nan")])
    assert [v.pair for v in truth.violations()] == ["1-2"]


def test_the_peak_is_that_of_a_history_and_of_the_value_before_it():
    truth = PairExtremes(pairs())
    for times, h, highest in (
        ([0.1, 0.2], [-1.0, -2.0], -0.99),
        ([0.3, 0.4], [-3.0, -2.5], -1.99),
        ([0.5, 0.6], [-3.0, -4.0], -2.49),
    ):
        peak, _ = show(truth, times, p1_2=h)
        assert peak == pytest.approx(highest)
    assert truth.largest_h_tot == pytest.approx(-0.99)


def test_the_worst_pair_is_that_of_all_steps_and_the_largest_that_of_the_last():
    truth = PairExtremes(pairs())
    table = np.full((3, len(labels())), -50.0)
    table[:2, labels().index("3-5")], table[:2, labels().index("1-3")] = [-1.0, -4.0], -2.0
    table[2, labels().index("1-2")] = -3.0
    extremes = truth.add([steps([0.1, 0.2, 0.3], table, table.max(axis=1), [0, 0, 1])], 2)
    assert truth.worst_pair == "3-5"
    assert [labels()[pair] for pair in extremes.pairs] == ["1-3", "1-2"]


def test_what_is_unsafe_at_the_start_is_so_from_zero_on():
    truth = PairExtremes(pairs())
    show(truth, [0.0, 0.1], p1_2=[0.5, 0.4])
    (violation,) = truth.violations()
    assert (violation.first, violation.duration) == (0.0, 0.1)


def test_what_a_pair_does_once_it_is_excluded_is_not_counted():
    truth = PairExtremes(pairs())
    show(truth, [0.1], p1_2=[0.5])
    assert truth.excluded() is None
    truth.exclude(np.array([0]), 0.15)
    _, crossings = show(truth, [0.2], p1_2=[2.0], p3_5=[0.25])
    (excluded,) = truth.excluded()
    assert (excluded.pair, excluded.first, excluded.worst) == ("1-2", 0.2, 2.0)
    violations = [(v.pair, v.first, v.end, v.worst) for v in truth.violations()]
    assert violations == [("1-2", 0.1, 0.15, 0.5), ("3-5", 0.2, None, 0.25)]
    assert crossings == [(0.2, "1-2", True), (0.2, "3-5", True)]
    assert truth.in_words(Crossing(0.2, 0, True)).startswith("1-2 left the safe set, not counted")
    three_five = labels().index("3-5")
    assert truth.in_words(Crossing(0.2, three_five, True)) == "3-5 left the safe set"
    assert (truth.worst_h, truth.worst_pair) == (0.5, "1-2")


def labels() -> list[str]:
    return [pairs().label(pair) for pair in pairs().pairs]
