"""Measures of a task on trajectories that are computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.recording.metrics.measures import (
    InputSeries,
    Thresholds,
    arrival_time,
    deadlock_time,
    input_deviation,
    input_energy,
    mean_over_time,
)

LIMITS = Thresholds(arrival=0.5, still=0.25, patience=5.0)
finite = st.floats(-10.0, 10.0)


def held(*values: float, nominal: float = 0.0) -> InputSeries:
    """Return scalar inputs of half a second each."""
    u = np.array(values)[:, None]
    return InputSeries(np.full(len(u), 0.5), u, np.full_like(u, nominal))


def line(t: np.ndarray, stop: float = np.inf, away: float = 0.0) -> np.ndarray:
    """Return positions of an agent that moves along x at 1 m/s and stands from `stop` on."""
    return np.column_stack([np.minimum(t, stop) + away, np.zeros_like(t)])


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


def deadlock(t: np.ndarray, p: np.ndarray, goal: tuple[float, float]) -> float:
    return deadlock_time(t, p, np.linalg.norm(p - goal, axis=1), LIMITS)


def test_an_agent_that_stands_away_from_its_goal_is_in_deadlock():
    t = np.linspace(0.0, 20.0, 401)
    # It stands from t = 8 s on; within 0.25 m of that place it is from t = 7.75 s on.
    assert deadlock(t, line(t, stop=8.0), (15.0, 0.0)) == pytest.approx(12.25, abs=0.2)


def test_an_agent_that_stands_at_its_goal_moves_or_waits_briefly_is_not():
    t = np.linspace(0.0, 20.0, 401)
    assert deadlock(t, line(t, stop=8.0), (8.3, 0.0)) == 0.0
    assert deadlock(t, line(t), (50.0, 0.0)) == 0.0
    brief = np.column_stack([np.where(t < 8.0, t, np.maximum(8.0, t - 4.0)), 0.0 * t])
    assert deadlock(t, brief, (50.0, 0.0)) == 0.0
    short = np.linspace(0.0, 4.9, 99)
    assert deadlock(short, line(short, stop=0.0), (50.0, 0.0)) == 0.0


def test_trembling_in_place_is_deadlock_and_circling_is_not():
    t = np.linspace(0.0, 20.0, 4001)
    around = np.column_stack([np.cos(t * 2.5), np.sin(t * 2.5)])
    assert deadlock(t, 0.1 * around, (5.0, 0.0)) == pytest.approx(20.0, abs=0.2)
    assert deadlock(t, 1.0 * around, (5.0, 0.0)) == 0.0


@given(step=st.floats(0.01, 0.2))
def test_deadlock_does_not_depend_on_how_often_states_are_recorded(step):
    t = np.arange(0.0, 20.0, step)
    assert deadlock(t, line(t, stop=8.0), (15.0, 0.0)) == pytest.approx(12.25, abs=0.5)


@pytest.mark.nightly
@pytest.mark.slow
def test_a_damaged_time_takes_no_more_memory_than_a_day():
    t = np.array([0.0, 1.0, 1e300])
    assert deadlock(t, np.zeros((3, 2)), (5.0, 0.0)) == pytest.approx(1e5)
