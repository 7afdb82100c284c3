"""Pair truth: when which pair left the safe set, how far and how long."""

import numpy as np
import pytest
from phalanx_plant.world.evaluation import EvaluatedSteps
from phalanx_plant.world.extremes import PairExtremes

from phalanx.theory.safety.composition import ComposedSet
from tests.unit.swarms import swarm_of_scenario


def pairs() -> ComposedSet:
    return swarm_of_scenario("unicycles").safe_set


def seen(truth: PairExtremes, times: list[float], **h: list[float]) -> tuple[float, set[int]]:
    """Show a history: the pairs' h by label ("1-2" as p1_2), all others -50; take its results."""
    table = np.full((len(times), len(labels())), -50.0)
    for name, values in h.items():
        table[:, labels().index(name[1:].replace("_", "-"))] = values
    zeros, all_pairs = np.zeros(len(times), dtype=np.intp), np.arange(len(labels()))
    h_tot, none = table.max(axis=1) + 0.01, np.zeros(0)
    truth.add(EvaluatedSteps(zeros, np.array(times), all_pairs, table, h_tot, none, zeros == 0))
    return truth.take(0)


def test_a_violation_has_its_pair_its_beginning_its_depth_and_its_length():
    truth = PairExtremes(pairs())
    seen(truth, [0.1, 0.2, 0.3], p1_2=[-1.0, -0.5, 0.5])
    seen(truth, [0.4, 0.6], p1_2=[2.0, -0.1], p3_5=[-3.0, 0.25])
    seen(truth, [0.7, 0.8], p1_2=[-0.2, 0.1], p3_5=[0.5, -1.0])
    deeper, shallower = truth.violations()
    assert (deeper.pair, shallower.pair) == ("1-2", "3-5")
    assert (deeper.first, deeper.worst, deeper.worst_at) == (0.3, 2.0, 0.4)
    assert deeper.duration == pytest.approx(0.1 + 0.1 + 0.1)
    assert (shallower.first, shallower.worst, shallower.worst_at) == (0.6, 0.5, 0.7)
    assert shallower.duration == pytest.approx(0.2 + 0.1)
    assert truth.worst_pair == "1-2"
    assert truth.worst_h_tot == pytest.approx(2.01)
    assert truth.worst_at == 0.4


def test_h_at_exactly_zero_is_safe():
    truth = PairExtremes(pairs())
    _, outside = seen(truth, [0.1, 0.2], p1_2=[0.0, -0.1])
    assert truth.violations() == []
    assert outside == set()


def test_lse_above_zero_is_no_departure_while_every_pair_is_at_most_zero():
    truth = PairExtremes(pairs())
    departures = []
    for t, h in ((0.1, -0.005), (0.2, 0.1), (0.3, -1.0)):
        _, outside = seen(truth, [t], p1_2=[h])
        departures.append(bool(outside))
    assert truth.worst_h_tot > 0.0
    assert departures == [False, True, False]


def test_an_h_that_is_not_a_number_is_not_safe():
    """NaN > 0 is false, but so is NaN <= 0, and safe is h <= 0."""
    truth = PairExtremes(pairs())
    seen(truth, [0.1, 0.2], p1_2=[-1.0, float("nan")])
    assert [v.pair for v in truth.violations()] == ["1-2"]


def test_the_peak_is_that_of_a_history_and_of_the_value_before_it():
    truth = PairExtremes(pairs())
    for times, h, highest in (
        ([0.1, 0.2], [-1.0, -2.0], -0.99),
        ([0.3, 0.4], [-3.0, -2.5], -1.99),
        ([0.5, 0.6], [-3.0, -4.0], -2.49),
    ):
        peak, _ = seen(truth, times, p1_2=h)
        assert peak == pytest.approx(highest)
    assert truth.worst_h_tot == pytest.approx(-0.99)


def test_the_worst_pair_is_that_of_all_steps_and_the_largest_that_of_the_last():
    truth = PairExtremes(pairs())
    for times, h, largest in (
        ([0.1, 0.2], {"p3_5": [-1.0, -4.0], "p1_3": [-2.0, -2.0]}, "1-3"),
        ([0.3], {"p1_2": [-3.0]}, "1-2"),
    ):
        seen(truth, times, **h)
        assert (truth.worst_pair, truth.label(truth.largest)) == ("3-5", largest)


def test_what_is_unsafe_at_the_start_is_so_from_zero_on():
    truth = PairExtremes(pairs())
    seen(truth, [0.0, 0.1], p1_2=[0.5, 0.4])
    (violation,) = truth.violations()
    assert (violation.first, violation.duration) == (0.0, 0.1)


def test_what_a_pair_does_once_it_is_set_apart_is_counted_apart():
    truth = PairExtremes(pairs())
    seen(truth, [0.1], p1_2=[0.5])
    truth.set_apart(np.array([0]))
    _, outside = seen(truth, [0.2], p1_2=[2.0], p3_5=[0.25])
    (apart,) = truth.apart()
    assert (apart.pair, apart.first, apart.worst, apart.worst_at) == ("1-2", 0.2, 2.0, 0.2)
    found = [(each.pair, each.first, each.worst) for each in truth.violations()]
    assert found == [("1-2", 0.1, 0.5), ("3-5", 0.2, 0.25)]
    assert outside == {0, labels().index("3-5")}
    assert truth.left(0).startswith("1-2 left the safe set, set apart")
    assert truth.left(labels().index("3-5")) == "3-5 left the safe set"


def labels() -> list[str]:
    return [pairs().label(pair) for pair in pairs().pairs]
