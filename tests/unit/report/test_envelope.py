"""Envelopes: quantiles that are values there are, in each interval of time."""

import numpy as np
from matplotlib.figure import Figure

from phalanx.report.envelope import QUANTILES, draw_envelope, envelope


def curves(count: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Curve k has the value k + 100 t, at times a little beside those of the others."""
    t = np.add.outer(np.arange(samples), np.arange(count) / (2.0 * count))
    return t.ravel(), (np.arange(count) + 100.0 * np.floor(t)).ravel()


def test_of_curves_apart_each_quantile_is_a_curve() -> None:
    t, values = curves(101, 4)
    shuffled = np.random.default_rng(0).permutation(len(t))
    found = envelope(t[shuffled], values[shuffled], each=8)
    assert found.values.shape == (len(QUANTILES), 4)
    np.testing.assert_array_equal(found.values[:, 0], [0, 10, 50, 90, 100])
    np.testing.assert_array_equal(found.values[:, 3], [300, 310, 350, 390, 400])
    np.testing.assert_array_equal(found.edges[1:, 0], found.edges[:-1, 1])


def test_no_peak_is_lost_however_few_intervals_there_are() -> None:
    rng = np.random.default_rng(1)
    t, values = rng.uniform(0.0, 9.0, 50_000), rng.normal(size=50_000)
    values[[7, 4_321]] = -40.0, 50.0
    found = envelope(t, values, each=10**6)
    assert len(found.edges) <= 300
    assert (found.values[0].min(), found.values[-1].max()) == (-40.0, 50.0)
    assert (np.diff(found.values, axis=0) >= 0.0).all()


def test_what_is_not_a_number_and_an_interval_without_values_are_left_out() -> None:
    t = np.array([0.0, 0.1, 5.0, 9.9, 10.0])
    found = envelope(t, np.array([1.0, 3.0, np.nan, 5.0, 5.0]), each=20)
    np.testing.assert_array_equal(found.edges, [[0.0, 1.0], [9.0, 10.0]])
    np.testing.assert_array_equal(found.values[[0, -1]], [[1.0, 5.0], [3.0, 5.0]])
    nothing = envelope(np.zeros(2), np.full(2, np.nan), each=2)
    assert nothing.values.shape == (len(QUANTILES), 0)


def test_it_is_drawn_as_two_bands_and_a_line() -> None:
    axes = Figure().subplots()
    t, values = curves(101, 4)
    draw_envelope(axes, envelope(t, values, each=8), "#1f5fbf", "all")
    outer, inner = (band.get_paths()[0].vertices[:, 1] for band in axes.collections)
    assert (outer.min(), outer.max()) == (0.0, 400.0)
    assert (inner.min(), inner.max()) == (10.0, 390.0)
    (median,) = axes.lines
    assert sorted(set(median.get_ydata())) == [50.0, 150.0, 250.0, 350.0]
