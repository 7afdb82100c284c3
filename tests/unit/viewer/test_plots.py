"""What the viewer's plots keep of a run's past."""

import numpy as np
import pytest
from phalanx_viewer.feeds.history import (
    EMPTY_CODES,
    ConditionChange,
    agent_series,
    fates_of,
    series_width,
)
from phalanx_viewer.plots.content import FALSE, Period
from phalanx_viewer.plots.curves import Series, curve, envelope, farthest, highest, lowest, numbers
from phalanx_viewer.plots.lanes import lanes, zoom
from phalanx_viewer.plots.plots import empty_periods, fault_periods

from phalanx.faults.commands import Condition
from phalanx.recording.broadcasts import IN_TIME, LATE, LOST, Broadcast

T = np.linspace(0.0, 10.0, 5001)


@pytest.mark.parametrize(("keep", "peak"), [(highest, 1.0), (lowest, -1.0)])
def test_a_thinned_curve_goes_through_a_peak_that_one_step_makes(keep, peak):
    y = np.zeros_like(T)
    y[[1234, 3456]] = 1.0, -1.0
    thinned = curve(Series(T, y), keep, most=50)
    assert len(thinned.t) == len(thinned.y) == 50
    assert (max if peak > 0 else min)(thinned.y) == peak
    assert thinned.t[thinned.y.index(peak)] == pytest.approx(T[1234 if peak > 0 else 3456])


def test_a_thinned_input_keeps_its_spikes_on_both_sides():
    y = np.zeros_like(T)
    y[[1234, 3456]] = 1.0, -1.0
    thinned = curve(Series(T, y), farthest, most=50)
    assert (min(thinned.y), max(thinned.y)) == (-1.0, 1.0)


def test_a_curve_leaves_out_what_is_not_known():
    y = np.array([1.0, np.nan, 3.0])
    assert curve(Series(np.arange(3.0), y), highest).t == [0.0, 2.0]


def test_an_envelope_holds_every_agent_and_starts_with_the_first():
    agents = [Series(T[k:], np.full(5001 - k, float(k))) for k in range(0, 1000, 10)]
    everybody, most, middle = envelope(agents)
    assert everybody.t[0] == 0.0
    assert (everybody.y[-1], everybody.to[-1]) == (0.0, 990.0)
    assert (most.y[-1], most.to[-1]) == (99.0, 891.0)
    assert middle.y[-1] == 495.0
    assert everybody.to[0] == 0.0  # only agent 0 had begun


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


def test_a_lane_tells_the_share_of_broadcasts_late_and_lost_and_the_gravest_state():
    rows = np.zeros((10, series_width(inputs=1)))
    rows[:, 0] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]
    rows[2, 1] = EMPTY_CODES["backup"]
    speaking, silent = agent_series(rows), agent_series(np.delete(rows, [6, 7], axis=0))
    fates = [(IN_TIME, 0.5), (LATE, 0.6), (LOST, 0.7), (LOST, 3.5), (LATE, 9.5)]
    found = [Broadcast(1, 0, sent, sent, fate) for fate, sent in fates]
    first, second = lanes(fates_of(found), [speaking, silent], [1.0, 1.0], 0.0, 10.0, 10.0)
    assert first.late == "3000000009"
    assert first.lost == "3009000000"
    assert first.state == "0010000000"
    assert set(second.late + second.lost) == {"0"}
    assert second.state == "0010003300"


def test_a_lie_is_told_in_the_liars_lane_and_as_the_fate_of_its_broadcast():
    rows = np.zeros((10, series_width(inputs=1)))
    rows[:, 0] = np.arange(10.0)
    agents = [agent_series(rows)] * 3
    found = [Broadcast(1, 0, 4.5, 4.6, IN_TIME, lied) for lied in (False, True)]
    drawn = lanes(fates_of(found), agents, [2.0] * 3, 0.0, 10.0, 10.0, found)
    assert [lane.false for lane in drawn] == ["0" * 10, "0000100000", "0" * 10]
    told = zoom(found, agents, 5.0, 10.0, None).broadcasts
    assert [fate for *_, fate in told] == [IN_TIME, FALSE]


def test_the_zoom_holds_the_steps_and_broadcasts_around_the_worst_moment_alone():
    rows = np.zeros((100, series_width(inputs=1)))
    rows[:, 0] = 0.1 * np.arange(100)
    agents = [agent_series(rows)] * 3
    found = [Broadcast(1, 2, t, t + 0.02, IN_TIME) for t in rows[:, 0]]
    found += [Broadcast(1, 0, t, t, LOST) for t in rows[:, 0]]
    near = zoom(found, agents, 5.03, 9.9, None)
    assert (near.begin, near.end) == pytest.approx((4.63, 5.43))
    assert near.steps[0] == pytest.approx([4.7, 4.8, 4.9, 5.0, 5.1, 5.2, 5.3, 5.4])
    assert {fate for *_, fate in near.broadcasts} == {IN_TIME, LOST}
    assert all(near.begin <= sent <= near.end for _, sent, *_ in near.broadcasts)
    of_one = zoom(found, agents, 5.03, 9.9, 0).broadcasts
    assert 0 < len(of_one) < len(near.broadcasts)
    assert {receiver for _, _, receiver, _, _ in of_one} == {0}
    assert zoom(found, agents, 9.9, 9.9, None).end == pytest.approx(9.9)
