"""Curves of a recording, and lanes of the space-time diagram."""

from typing import NamedTuple

import numpy as np
import pytest
from matplotlib.figure import Figure

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
from phalanx.recording.curves.series import (
    QUANTILES,
    Series,
    envelope,
    extremes,
    lanes,
    zoom_window,
)
from phalanx.report.style import draw_envelope


def curves(count: int, samples: int) -> list[Series]:
    """Curve k has twice the value k + 100 t, at times a little after the others'."""
    t = np.repeat(np.arange(samples), 2)
    return [Series(t + k / (2.0 * count), k + 100.0 * t) for k in range(count)]


def test_fewer_points_keep_every_peak() -> None:
    y = np.sin(np.linspace(0.0, 30.0, 100_001))
    y[[777, 50_000]] = 9.0, -9.0
    y[20_000:40_000] = np.nan
    indices = extremes(y, 400)
    assert len(indices) <= 400
    assert {0, 777, 50_000, 100_000} <= set(indices.tolist())
    assert np.isnan(y[indices]).any()
    assert list(extremes(y[:300], 400)) == list(range(300))


def test_without_curves_an_envelope_has_no_interval() -> None:
    assert len(envelope([]).edges) == 0


def test_of_curves_apart_each_quantile_is_a_curve() -> None:
    bands = envelope(curves(101, 4))
    assert bands.values.shape == (len(QUANTILES), 4)
    np.testing.assert_array_equal(bands.values[:, 0], [0, 10, 50, 90, 100])
    np.testing.assert_array_equal(bands.values[:, 3], [300, 310, 350, 390, 400])
    np.testing.assert_array_equal(bands.edges[1:, 0], bands.edges[:-1, 1])


def test_no_peak_is_lost_however_few_intervals_there_are() -> None:
    rng = np.random.default_rng(1)
    t, values = rng.uniform(0.0, 9.0, 50_000), rng.normal(size=50_000)
    values[[7, 4_321]] = -40.0, 50.0
    bands = envelope([Series(t, values)])
    assert len(bands.edges) <= 300
    assert (bands.values[0].min(), bands.values[-1].max()) == (-40.0, 50.0)
    assert (np.diff(bands.values, axis=0) >= 0.0).all()


def test_what_is_not_a_number_and_an_interval_without_values_are_left_out() -> None:
    t = np.array([0.0, 0.1, 5.0, 9.9, 10.0, 10.0])
    bands = envelope([Series(t, np.array([1.0, 3.0, np.nan, 5.0, 5.0, 5.0]))])
    np.testing.assert_array_equal(bands.edges, [[0.0, 10.0 / 3.0], [20.0 / 3.0, 10.0]])
    np.testing.assert_array_equal(bands.values[[0, -1]], [[1.0, 5.0], [3.0, 5.0]])
    nothing = envelope([Series(np.zeros(2), np.full(2, np.nan))])
    assert nothing.values.shape == (len(QUANTILES), 0)


def test_it_is_drawn_as_two_bands_and_a_line() -> None:
    axes = Figure().subplots()
    draw_envelope(axes, envelope(curves(101, 4)), "#1f5fbf", "all")
    outer, inner = (band.get_paths()[0].vertices[:, 1] for band in axes.collections)
    assert (outer.min(), outer.max()) == (0.0, 400.0)
    assert (inner.min(), inner.max()) == (10.0, 390.0)
    (median,) = axes.lines
    assert sorted(set(median.get_ydata())) == [50.0, 150.0, 250.0, 350.0]


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
