"""The curves, bands and periods of a page's plots."""

import numpy as np
import pytest
from phalanx_viewer.plots.plots import Period, bands, curve, empty_periods, fault_periods, numbers

from phalanx.faults.commands import Condition
from phalanx.recording.curves.history import (
    EMPTY_CODES,
    ConditionChange,
    agent_series,
    series_width,
)
from phalanx.recording.curves.series import Series

T = np.linspace(0.0, 10.0, 5001)


@pytest.mark.parametrize(("side", "peak"), [("highest", 1.0), ("lowest", -1.0)])
def test_a_thinned_curve_goes_through_a_peak_that_one_step_makes(side, peak):
    y = np.zeros_like(T)
    y[[1234, 3456]] = 1.0, -1.0
    thinned = curve(Series(T, y), most=50, **dict.fromkeys({"highest", "lowest"} - {side}, False))
    assert len(thinned.t) == len(thinned.y) <= 50
    assert {min(thinned.y), max(thinned.y)} == {0.0, peak}
    assert thinned.t[thinned.y.index(peak)] == pytest.approx(T[1234 if peak > 0 else 3456])


def test_a_curve_leaves_out_what_is_not_known():
    y = np.array([1.0, np.nan, 3.0])
    assert curve(Series(np.arange(3.0), y)).t == [0.0, 2.0]


def test_the_bands_of_many_agents_hold_every_agent_and_start_with_the_first():
    agents = [Series(T[k:], np.full(5001 - k, float(k))) for k in range(0, 1000, 10)]
    everybody, most, middle = bands(agents)
    assert everybody.t[0] == 0.0
    assert (everybody.y[-1], everybody.to[-1]) == (0.0, 990.0)
    assert (most.y[-1], middle.y[-1], most.to[-1]) == (100.0, 500.0, 890.0)
    assert everybody.to[0] < 100.0  # only the first agents had begun


def test_numbers_are_rounded_to_significant_digits():
    assert numbers(np.array([0.0, -12345.6, 0.00012345, 1.0]), 4) == [0.0, -12350.0, 0.0001234, 1.0]


def test_a_backup_period_lasts_until_the_next_step_that_was_none():
    code = EMPTY_CODES["backup"]
    empty = [0.0, code, code, 0.0, EMPTY_CODES["no-authority"], code]
    rows = np.zeros((6, series_width(inputs=1)))
    rows[:, 0], rows[:, 1] = np.arange(6.0), empty
    assert empty_periods(2, agent_series(rows)) == [
        Period(2, "backup", 1.0, 3.0),
        Period(2, "backup", 5.0, 5.0),
        Period(2, "no-authority", 4.0, 5.0),
    ]


def test_a_fault_period_lasts_until_the_same_agent_is_fine_or_to_the_end():
    changes = [
        ConditionChange(1.0, 0, Condition.FROZEN),
        ConditionChange(2.0, 1, Condition.DEAD),
        ConditionChange(3.0, 0, Condition.FINE),
    ]
    assert fault_periods(changes, 9.0) == [
        Period(0, "frozen", 1.0, 3.0),
        Period(1, "dead", 2.0, 9.0),
    ]


def test_a_held_value_lasts_until_later_and_nothing_is_held_before_the_first():
    extended = Series(np.array([0.0, 1.0]), np.array([2.0, 3.0])).extended(5.0)
    np.testing.assert_array_equal(extended, [[0.0, 1.0, 5.0], [2.0, 3.0, 3.0]])
    assert len(Series(np.zeros(0), np.zeros(0)).extended(5.0).t) == 0
