"""Quadrotors: zero inputs hover, tilts accelerate, and a planar one is a slice of one in space."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples.planar_quadrotors import PlanarQuadrotor
from phalanx.theory.arrays import Array
from phalanx.theory.models.aerial import GRAVITY, Quadrotor
from phalanx.theory.models.dynamics import Dynamics

SPACE, PLANE = Quadrotor(4.0, 0.5), PlanarQuadrotor(4.0, 0.5)
number = st.floats(-1.0, 1.0)


def rate(dynamics: Dynamics, x: list[float], u: list[float]) -> Array:
    found: Array = np.array(
        ca.DM(dynamics.drift(ca.SX(x)) + dynamics.actuation(ca.SX(x)) @ ca.SX(u))
    ).ravel()
    return found


@pytest.mark.parametrize("dynamics", [SPACE, PLANE])
def test_a_quadrotor_at_rest_hovers_on_zero_inputs(dynamics):
    n, m = len(dynamics.states), len(dynamics.inputs)
    assert not rate(dynamics, [0.0] * n, [0.0] * m).any()


def test_the_thrust_points_where_the_tilt_does():
    pitched = rate(SPACE, [0.0] * 7 + [0.3, 0.0], [0.0] * 3)
    assert pitched[3] == pytest.approx(GRAVITY * np.sin(0.3))
    rolled = rate(SPACE, [0.0] * 8 + [0.3], [0.0] * 3)
    assert rolled[4] == pytest.approx(-GRAVITY * np.sin(0.3))
    assert pitched[5] == rolled[5] == pytest.approx(GRAVITY * (np.cos(0.3) - 1.0))


def test_an_input_is_reached_with_the_lag_of_its_loop():
    found = rate(SPACE, [0.0] * 9, [1.0, 0.5, -0.5])
    assert found[6:] == pytest.approx([1.0 / 0.1, 0.5 / 0.15, -0.5 / 0.15])


@given(st.lists(number, min_size=6, max_size=6), st.lists(number, min_size=2, max_size=2))
def test_without_roll_a_quadrotor_moves_as_a_planar_one(x, u):
    px, pz, vx, vz, c, theta = x
    planar = rate(PLANE, x, u)
    spatial = rate(SPACE, [px, 0.0, pz, vx, 0.0, vz, c, theta, 0.0], [*u, 0.0])
    assert spatial[[0, 2, 3, 5, 6, 7]] == pytest.approx(planar)
    assert not spatial[[1, 4, 8]].any()


def test_rotors_that_would_have_to_pull_down_and_flips_are_refused():
    with pytest.raises(ValueError, match=r"thrust: expected less than 9\.81"):
        Quadrotor(10.0, 0.5)
    with pytest.raises(ValueError, match="tilt: expected less than pi / 2"):
        Quadrotor(4.0, 1.6)
