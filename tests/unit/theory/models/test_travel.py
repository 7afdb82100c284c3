"""Travel of an output point: never more than its dynamics' bound, and hardly less."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.aerial import Quadrotor
from phalanx.theory.models.dynamics import Bounded, Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.wheeled import DifferentialDrive, DynamicUnicycle, Unicycle

TIME, PHI = 0.4, 0.3
BOUNDED = {
    "single": (SingleIntegrator(2.0), [2.0, 2.0]),
    "single in space": (SingleIntegrator(2.0, 3), [2.0] * 3),
    "double": (DoubleIntegrator(2.0), [2.0] * 3),
    "double with drag": (DoubleIntegrator(2.0, drag=0.7, dimension=2), [2.0] * 2),
    "triple": (TripleIntegrator(3.0), [3.0] * 3),
    "unicycle": (Unicycle(4.0, 2.0), [4.0, 2.0]),
    "dynamic unicycle": (DynamicUnicycle(4.0, 8.0), [4.0, 8.0]),
    "dynamic unicycle with drag": (DynamicUnicycle(4.0, 8.0, 0.25, 1.0, 4.0), [4.0, 8.0]),
    "differential drive": (DifferentialDrive(20.0, 0.1, 0.4), [20.0, 20.0]),
    "differential drive, long nose": (DifferentialDrive(20.0, 0.1, 0.4, 0.6), [20.0, 20.0]),
    "quadrotor": (Quadrotor(4.0, 0.5), [4.0, 0.5, 0.5]),
}


def motion(dynamics: Dynamics) -> tuple[CompiledFunction, CompiledFunction]:
    """(x, u) -> x', and x -> p."""
    x, u = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("u", len(dynamics.inputs))
    rate = dynamics.drift(x) + dynamics.actuation(x) @ u
    return CompiledFunction([x, u], [rate]), CompiledFunction([x], [dynamics.position(x)])


@pytest.mark.slow
@pytest.mark.parametrize("name", BOUNDED)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=12)
def test_no_input_and_no_disturbance_carry_the_output_farther(name, seed):
    dynamics, most = BOUNDED[name]
    assert isinstance(dynamics, Bounded)
    rng = np.random.default_rng(seed)
    n = len(dynamics.states)
    x = rng.normal(size=n)
    travel = dynamics.travel(x, TIME, PHI)
    rate, position = motion(dynamics)
    begin, steps = position(x)[0], 200
    for step in range(steps):
        if step % 20 == 0:
            u = rng.choice([-1.0, 1.0], len(most)) * most
            phi = rng.normal(size=n)
            phi *= PHI / np.linalg.norm(phi)
        middle = x + TIME / steps / 2 * (rate(x, u)[0] + phi)
        x = x + TIME / steps * (rate(middle, u)[0] + phi)
    assert np.linalg.norm(position(x)[0] - begin) <= travel + 1e-6


@pytest.mark.parametrize(
    ("dynamics", "distance", "excess"),
    [
        (SingleIntegrator(2.0), np.sqrt(2.0) * 2.0 * 0.5, 1e-9),
        (DoubleIntegrator(2.0), np.sqrt(3.0) * 2.0 * 0.5**2 / 2, 1e-9),
        (Unicycle(4.0, 2.0), 4.0 * 0.5, 0.02),
    ],
)
def test_the_bound_is_nearly_what_the_largest_input_makes_of_it(dynamics, distance, excess):
    travel = dynamics.travel(np.zeros(len(dynamics.states)), 0.5, 0.0)
    assert distance * (1 - 1e-9) <= travel <= distance * (1 + excess)
