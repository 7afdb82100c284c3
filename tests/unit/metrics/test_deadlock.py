"""Deadlock: who wants to move and stands, on positions and inputs that are made by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.recording.metrics.deadlock import held_by_rows, waits
from phalanx.recording.records import Step
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.rows.origin import Origin


def line(t: np.ndarray, stop: float = np.inf) -> np.ndarray:
    """Return positions of an agent that moves along x at 1 m/s and stands from `stop` on."""
    return np.column_stack([np.minimum(t, stop), np.zeros_like(t)])


def deadlock(t: np.ndarray, p: np.ndarray, goal: tuple[float, float]) -> float:
    """Return the time in deadlock of an agent that wants to move while it is not at its goal."""
    held = (np.linalg.norm(p - goal, axis=1) > 0.5).astype(float)
    stretches = waits(t, p, np.full_like(t, 2.0), held, still=0.25, patience=5.0)
    return sum(end - begin for begin, end in stretches)


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


def test_one_that_others_pass_is_not_in_deadlock():
    t = np.linspace(0.0, 20.0, 401)
    passing = 2.0 + np.abs(t % 4.0 - 2.0)
    assert waits(t, np.zeros((401, 2)), passing, np.ones(401), 0.25, 5.0) == []


@pytest.mark.parametrize(
    ("wish", "u", "held"),
    [
        ((1.0, 0.0), (0.0, 0.0), 1.0),
        ((1.0, 0.0), (1.0, 0.0), 0.0),  # it does what it wants
        ((9.0, 0.0), (2.0, 0.0), 0.0),  # as fast as its actuators allow
        ((9.0, 0.0), (0.5, 0.0), 1.0),
        ((0.1, 0.0), (0.0, 0.0), 0.0),  # it hardly wants to move
    ],
)
def test_a_wish_is_held_if_it_is_one_to_move_and_the_input_another(wish, u, held):
    step = Step(
        agent="a", k=0, t=0.0, t_apply=1.0, u=u, u_nom=wish, origin=Origin.QP, residual=0.0,
        solve_time=0.0, ages=[], fates=[],
    )  # fmt: skip
    times = np.array([0.5, 1.0, 2.0])
    robot = SingleIntegrator(speed=2.0)
    assert held_by_rows(robot, [step], times).tolist() == [0.0, held, held]


def test_one_that_died_wants_nothing_though_its_actuator_holds_its_last_input():
    steps = [
        Step(
            agent="a", k=k, t=0.1 * k, t_apply=0.1 * k, u=(0.0, 0.0), u_nom=(1.0, 0.0),
            origin=Origin.QP, residual=0.0, solve_time=0.0, ages=[], fates=[],
        )
        for k in range(5)
    ]  # fmt: skip
    times = np.array([0.2, 0.5, 1.0, 50.0])
    assert held_by_rows(SingleIntegrator(speed=2.0), steps, times).tolist() == [1.0, 1.0, 0.0, 0.0]
