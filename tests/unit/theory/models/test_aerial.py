"""Quadrotors: in space, in the plane, and one as fits to flights have it."""

from collections.abc import Callable
from dataclasses import asdict

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.planar_quadrotors import PlanarQuadrotor
from phalanx.schema.registry import construct
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.laws.tracking import output_chain
from phalanx.theory.models.aerial import GRAVITY, IdentifiedQuadrotor, Quadrotor
from phalanx.theory.models.dynamics import Dynamics
from tests.unit.theory.users_own import runge_kutta

MODEL = IdentifiedQuadrotor(
    3.0, 0.3, thrust_lag=0.1, filter_lag=0.05, stiffness=300.0, damping=20.0, drag=0.4
)
SPACE, PLANE = Quadrotor(4.0, 0.5), PlanarQuadrotor(4.0, 0.5)
number = st.floats(-1.0, 1.0)
X, U = ca.SX.sym("x", len(MODEL.states)), ca.SX.sym("u", len(MODEL.inputs))
RATE = ca.Function("rate", [X, U], [MODEL.drift(X) + MODEL.actuation(X) @ U])


def rate(x: Array, u: Array) -> Array:
    return np.array(RATE(x, u)).ravel()


def moved(x: Array, u: Array, seconds: float, steps: int) -> list[Array]:
    """The states of steps, the first included."""
    states = [np.array(x, dtype=float)]
    for _ in range(steps):
        states.append(runge_kutta(lambda y: rate(y, u), states[-1], seconds / steps))
    return states


@pytest.mark.slow
@pytest.mark.parametrize("u", [[1.0, 0.2, -0.1], [-2.0, -0.3, 0.3]])
def test_constant_inputs_are_reached_and_no_more_moves_but_the_position(u):
    end = moved(np.zeros(12), np.array(u), 3.0, 3000)[-1]
    assert end[6:9] == pytest.approx(u, abs=1e-6)
    assert end[9] == pytest.approx(u[0])
    assert end[10:] == pytest.approx([0.0, 0.0], abs=1e-6)


def test_a_jump_of_the_commanded_angle_is_overshot_as_second_order_has_it():
    states = moved(np.zeros(12), np.array([0.0, 0.2, 0.0]), 1.0, 1000)
    ratio = 20.0 / (2.0 * np.sqrt(300.0))
    overshoot = np.exp(-np.pi * ratio / np.sqrt(1.0 - ratio**2))
    assert max(x[7] for x in states) == pytest.approx(0.2 * (1.0 + overshoot), rel=1e-4)


def test_drag_ends_a_motion_exponentially():
    start = np.zeros(12)
    start[3:6] = [1.0, -2.0, 0.5]
    end = moved(start, np.zeros(3), 2.0, 200)[-1]
    assert end[3:6] == pytest.approx(np.exp(-0.4 * 2.0) * start[3:6])


@given(st.lists(number, min_size=9, max_size=9), st.lists(number, min_size=3, max_size=3))
def test_without_drag_it_accelerates_as_a_quadrotor(x, u):
    other, free = Quadrotor(3.0, 0.3), IdentifiedQuadrotor(3.0, 0.3, 0.1, 0.05, 300.0, 20.0)
    expected = np.array(ca.DM(other.drift(ca.SX(x)) + other.actuation(ca.SX(x)) @ ca.SX(u)))
    drift = np.array(ca.DM(free.drift(ca.SX([*x, 0.0, 0.0, 0.0])))).ravel()
    assert drift[:6] == pytest.approx(expected.ravel()[:6])


def _derivatives() -> Callable[[Array], Array]:
    """The position and three derivatives without inputs, shape (4, 3), by the state."""
    chain = output_chain(MODEL)
    evaluate = CompiledFunction([chain.x], [ca.horzcat(*chain.derivatives[:-1]).T])
    return lambda x: evaluate(x)[0]


@given(st.lists(number, min_size=12, max_size=12))
def test_inputs_act_on_the_fourth_derivative_of_the_position_and_on_no_lower(x):
    state = np.array(x)
    derivatives = _derivatives()
    assert output_chain(MODEL).degree == 4
    dt = 1e-3
    for u in (np.zeros(3), np.array([3.0, 0.3, -0.3])):
        before, at, after = moved(state - dt * rate(state, u), u, 2 * dt, 2)
        slope = (derivatives(after) - derivatives(before)) / (2 * dt)
        size = 1.0 + np.abs(derivatives(at)).max()
        assert slope[:3] == pytest.approx(derivatives(at)[1:], abs=0.05 * size)


@pytest.mark.slow
@given(st.lists(number, min_size=12, max_size=12))
def test_an_input_is_found_for_a_desired_fourth_derivative(x):
    state, desired = np.array(x), np.array([100.0, -50.0, 20.0])
    chain, symbols, derivatives = output_chain(MODEL), ca.SX.sym("desired", 3), _derivatives()
    (u,) = CompiledFunction([chain.x, symbols], [chain.input_for(symbols)])(state, desired)
    step = 1e-6

    def third(u: Array) -> Array:
        return (derivatives(state + step * rate(state, u))[3] - derivatives(state)[3]) / step

    assert third(u) - third(np.zeros(3)) == pytest.approx(desired, rel=1e-3, abs=0.05)


@pytest.mark.parametrize(
    ("field", "value"), [("thrust", GRAVITY), ("tilt", 1.6), ("damping", 0.0), ("drag", -0.1)]
)
def test_what_no_quadrotor_has_is_refused_by_its_field(field, value):
    table = {"type": "identified-quadrotor", **asdict(MODEL), field: value}
    with pytest.raises(ValueError, match=field):
        construct(Dynamics, table)


def rate_of(dynamics: Dynamics, x: list[float], u: list[float]) -> Array:
    rates = ca.DM(dynamics.drift(ca.SX(x)) + dynamics.actuation(ca.SX(x)) @ ca.SX(u))
    return np.array(rates).ravel()


@pytest.mark.parametrize("dynamics", [SPACE, PLANE, MODEL])
def test_a_quadrotor_at_rest_hovers_on_zero_inputs(dynamics):
    n, m = len(dynamics.states), len(dynamics.inputs)
    assert not rate_of(dynamics, [0.0] * n, [0.0] * m).any()


def test_the_thrust_points_where_the_tilt_does():
    pitched = rate_of(SPACE, [0.0] * 7 + [0.3, 0.0], [0.0] * 3)
    assert pitched[3] == pytest.approx(GRAVITY * np.sin(0.3))
    rolled = rate_of(SPACE, [0.0] * 8 + [0.3], [0.0] * 3)
    assert rolled[4] == pytest.approx(-GRAVITY * np.sin(0.3))
    assert pitched[5] == rolled[5] == pytest.approx(GRAVITY * (np.cos(0.3) - 1.0))


def test_an_input_is_reached_with_the_lag_of_its_loop():
    rates = rate_of(SPACE, [0.0] * 9, [1.0, 0.5, -0.5])
    assert rates[6:] == pytest.approx([1.0 / 0.1, 0.5 / 0.15, -0.5 / 0.15])


@given(st.lists(number, min_size=6, max_size=6), st.lists(number, min_size=2, max_size=2))
def test_without_roll_a_quadrotor_moves_as_a_planar_one(x, u):
    px, pz, vx, vz, c, theta = x
    planar = rate_of(PLANE, x, u)
    spatial = rate_of(SPACE, [px, 0.0, pz, vx, 0.0, vz, c, theta, 0.0], [*u, 0.0])
    assert spatial[[0, 2, 3, 5, 6, 7]] == pytest.approx(planar)
    assert not spatial[[1, 4, 8]].any()


def test_rotors_that_would_have_to_pull_down_and_flips_are_refused():
    with pytest.raises(ValueError, match=r"thrust: expected less than 9\.81"):
        Quadrotor(10.0, 0.5)
    with pytest.raises(ValueError, match="tilt: expected less than pi / 2"):
        Quadrotor(4.0, 1.6)
