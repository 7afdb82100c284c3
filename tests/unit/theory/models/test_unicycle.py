"""The unicycle in its native input (ν, ω) is the paper's in the output input u."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.polytope import constant_polytope, polytope
from phalanx.theory.models.wheeled import DifferentialDrive, Unicycle
from tests.unit.theory.users_own import OutputUnicycle

NATIVE, PRINTED = Unicycle(4.0, 2.0, 0.25), OutputUnicycle(4.0, 2.0, 0.25)
angles = st.floats(-10.0, 10.0)


@pytest.fixture(scope="module")
def printed_polytope() -> CompiledFunction:
    """(A, b) of the paper's polytope at a state."""
    x = ca.SX.sym("x", 3)
    return CompiledFunction([x], list(PRINTED.input_polytope(x)))


@pytest.fixture(scope="module")
def fields() -> CompiledFunction:
    """g natively and as the paper prints it."""
    x = ca.SX.sym("x", 3)
    return CompiledFunction([x], [NATIVE.actuation(x), PRINTED.actuation(x)])


@given(angles)
def test_the_native_box_is_the_papers_polytope_seen_through_the_transformation(
    printed_polytope, theta
):
    box = constant_polytope(*NATIVE.input_polytope(ca.SX.sym("x", 3)))
    assert box is not None
    printed = polytope(*printed_polytope(np.array([1.0, 2.0, theta])))
    images = (PRINTED.native(theta) @ printed.corners.T).T
    assert sorted(map(tuple, images.round(6) + 0.0)) == sorted(map(tuple, box.corners))


@given(angles, st.floats(-9, 9), st.floats(-9, 9))
def test_an_input_is_admissible_natively_just_when_the_paper_admits_it(
    printed_polytope, theta, nu, omega
):
    u = np.linalg.inv(PRINTED.native(theta)) @ [nu, omega]
    A, b = printed_polytope(np.array([0.0, 0.0, theta]))
    inside = abs(nu) <= 4.0 + 1e-9 and abs(omega) <= 2.0 + 1e-9
    assert (A @ u <= b + 2e-9).all() == inside or min(abs(abs(nu) - 4), abs(abs(omega) - 2)) < 1e-8


@given(angles, st.floats(-9, 9), st.floats(-9, 9))
def test_the_native_metric_is_the_distance_of_output_inputs(theta, nu, omega):
    u = np.linalg.inv(PRINTED.native(theta)) @ [nu, omega]
    weights = np.array(NATIVE.input_metric())
    assert weights @ np.array([nu, omega]) ** 2 == pytest.approx(u @ u, abs=1e-9)


@given(angles, st.floats(-4, 4), st.floats(-2, 2))
def test_both_forms_move_the_unicycle_equally_and_the_output_by_u(fields, theta, nu, omega):
    g, g_printed = fields(np.array([0.3, -0.7, theta]))
    native = np.array([nu, omega])
    u = np.linalg.inv(PRINTED.native(theta)) @ native
    assert g @ native == pytest.approx(g_printed @ u, abs=1e-9)
    ahead = np.array([[1, 0, -0.25 * np.sin(theta)], [0, 1, 0.25 * np.cos(theta)]])
    assert ahead @ g @ native == pytest.approx(u, abs=1e-9)


@pytest.mark.parametrize("dimension", [0, 1, 4])
def test_a_single_integrator_lives_in_two_or_three_dimensions(dimension):
    with pytest.raises(ValueError, match=f"dimension: expected 2 or 3, got {dimension}"):
        SingleIntegrator(1.0, dimension)


@given(angles, st.floats(-20.0, 20.0), st.floats(-20.0, 20.0))
def test_a_differential_drive_is_a_unicycle_whose_speed_and_turn_rate_share_two_wheels(
    theta, rate_left, rate_right
):
    drive = DifferentialDrive(20.0, wheel_radius=0.1, track=0.4)
    x = ca.SX([1.0, 2.0, theta])
    nu, omega = 0.1 * (rate_right + rate_left) / 2, 0.1 * (rate_right - rate_left) / 0.4
    driven = drive.actuation(x) @ ca.SX([rate_left, rate_right])
    assert np.allclose(ca.DM(driven), ca.DM(NATIVE.actuation(x) @ ca.SX([nu, omega])))
