"""Measures of a task on trajectories that are computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.recording.metrics.measures import (
    InputSeries,
    arrival_time,
    input_deviation,
    input_energy,
    mean_over_time,
)

finite = st.floats(-10.0, 10.0)


def held(*values: float, nominal: float = 0.0) -> InputSeries:
    """Return scalar inputs of half a second each."""
    u = np.array(values)[:, None]
    return InputSeries(np.full(len(u), 0.5), u, np.full_like(u, nominal))


def test_a_mean_over_time_weighs_by_time_and_not_by_samples():
    t = np.array([0.0, 0.001, 0.002, 2.0])
    assert mean_over_time(t, np.array([1.0, 1.0, 1.0, 1.0])) == pytest.approx(1.0)
    ramp = np.array([0.0, 1.0, 2.0])
    assert mean_over_time(ramp, 3.0 * ramp) == pytest.approx(3.0)
    assert mean_over_time(np.array([7.0]), np.array([4.0])) == 4.0
    assert mean_over_time(np.empty(0), np.empty(0)) is None


@given(values=st.lists(finite, min_size=2, max_size=9))
def test_a_mean_lies_between_the_least_and_the_largest(values):
    mean = mean_over_time(np.arange(len(values), dtype=float), np.array(values))
    assert min(values) - 1e-9 <= mean <= max(values) + 1e-9


def test_an_agent_has_arrived_once_it_stays():
    t = np.arange(6.0)
    assert arrival_time(t, np.array([3.0, 0.4, 2.0, 0.5, 0.2, 0.0]), within=0.5) == 3.0
    assert arrival_time(t, np.zeros(6), within=0.5) == 0.0
    assert arrival_time(t, np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.6]), within=0.5) is None


def test_energy_is_the_integral_of_the_square():
    assert input_energy(held(2.0, 0.0, -4.0)) == pytest.approx(0.5 * (4.0 + 16.0))


@given(values=st.lists(finite, min_size=1, max_size=9), factor=finite)
def test_energy_grows_with_the_square_of_the_input(values, factor):
    once, scaled = input_energy(held(*values)), input_energy(held(*[factor * v for v in values]))
    assert scaled == pytest.approx(factor**2 * once, abs=1e-9)


def test_a_deviation_is_a_mean_over_the_time_in_which_the_law_is_known():
    inputs = held(2.0, 0.0, -4.0, nominal=1.0)
    assert input_deviation(inputs) == pytest.approx((1.0 + 1.0 + 5.0) / 3)
    inputs.u_nom[2] = np.nan
    assert input_deviation(inputs) == pytest.approx(1.0)
    inputs.u_nom[:] = np.nan
    assert input_deviation(inputs) is None


@given(values=st.lists(finite, min_size=1, max_size=9))
def test_an_input_that_is_the_laws_does_not_deviate(values):
    inputs = held(*values)
    assert input_deviation(inputs._replace(u_nom=inputs.u)) == 0.0
