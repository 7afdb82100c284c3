"""Lanes of the space-time diagram: late, lost and false broadcasts, silent agents."""

from typing import NamedTuple

import numpy as np
import pytest

from phalanx.recording.curves.history import (
    BROADCAST,
    EMPTY_CODES,
    FATES,
    IN_TIME,
    LATE,
    LOST,
    Fates,
    agent_series,
    fates_of,
    series_width,
)
from phalanx.recording.curves.series import lanes, zoom_window


class Past(NamedTuple):
    """The part of a history that lanes are made of."""

    broadcasts: np.recarray
    fates: Fates


def past(*fates: tuple[str, float, bool]) -> Past:
    """Broadcasts of the second agent to the first: fate, when it was sent [s], whether false."""
    rows = [(1, 0, sent, sent, FATES.index(fate), false) for fate, sent, false in fates]
    broadcasts = np.array(rows, BROADCAST).view(np.recarray)
    return Past(broadcasts, fates_of(broadcasts))


def test_a_lane_shows_the_share_of_broadcasts_late_and_lost_and_the_gravest_state():
    rows = np.zeros((10, series_width(inputs=1)))
    rows[:, 0] = np.arange(10.0)
    rows[2, 1] = EMPTY_CODES["backup"]
    speaking, silent = agent_series(rows), agent_series(np.delete(rows, [6, 7], axis=0))
    fates = [(IN_TIME, 0.5), (LATE, 0.6), (LOST, 0.7), (LOST, 3.5), (LATE, 9.5)]
    run = past(*((*fate, False) for fate in fates))
    late, lost, state, _ = lanes(run, [speaking, silent], [1.0, 1.0], (0.0, 10.0), 10.0, 200)
    np.testing.assert_allclose(late[0], [1 / 3, 0, 0, 0, 0, 0, 0, 0, 0, 1])
    np.testing.assert_allclose(lost[0], [1 / 3, 0, 0, 1, 0, 0, 0, 0, 0, 0])
    np.testing.assert_array_equal(state[0], [0, 0, 1, 0, 0, 0, 0, 0, 0, 0])
    assert not (late[1] + lost[1]).any()
    np.testing.assert_array_equal(state[1], [0, 0, 1, 0, 0, 0, 3, 3, 0, 0])


def test_a_false_broadcast_is_in_its_senders_lane():
    rows = np.zeros((10, series_width(inputs=1)))
    rows[:, 0] = np.arange(10.0)
    run = past(*((IN_TIME, 4.5, lied) for lied in (False, True, True)))
    traces = lanes(run, [agent_series(rows)] * 3, [2.0] * 3, (0.0, 10.0), 10.0, 200)
    np.testing.assert_array_equal(traces.false, np.outer([0, 1, 0], np.arange(10) == 4))


def test_of_many_steps_there_are_as_many_intervals_as_asked_for():
    rows = np.zeros((1000, series_width(inputs=1)))
    rows[:, 0] = 0.01 * np.arange(1000)
    found = lanes(past(), [agent_series(rows)], [1.0], (0.0, 10.0), 10.0, 50)
    assert {of.shape for of in found} == {(1, 50)}


def test_the_zoom_is_a_few_samples_around_the_worst_moment():
    rows = np.zeros((100, series_width(inputs=1)))
    rows[:, 0] = 0.1 * np.arange(100) + 7.0
    agents = [agent_series(rows, sampled=rows[:, 0] - 7.0)] * 3
    assert zoom_window(agents, 5.03, 9.9) == pytest.approx((4.63, 5.43))
    assert zoom_window(agents, 9.9, 9.9)[1] == pytest.approx(9.9)
