"""Enclosures of a state within a horizon, and the inputs that an actuator accepts."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import admissible_corners, admissible_inputs, enclose, fastest
from phalanx.theory.margins.integrated import INFLATIONS
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.polytope import ACTUATION
from phalanx.theory.models.wheeled import DynamicUnicycle, Unicycle
from phalanx.theory.safety.composition import Member
from tests.layers import layered
from tests.unit.theory.users_own import Rail

PHI = 0.5
CASES = {"unicycle": Unicycle(4.0, 2.0), "dynamic unicycle": DynamicUnicycle(2.0, 4.0)}


@cache
def compiled(dynamics, constant_input, proven=False):
    member = Member("a", dynamics, False)
    x, T = ca.SX.sym("x", len(dynamics.states)), ca.SX.sym("T")
    with outwards() if proven else nullcontext():
        inputs = None if constant_input else admissible_inputs(member)
        e = enclose(member, x, inputs, PHI, T, INFLATIONS)
    ends = [ca.vertcat(*side) for side in zip(*e.states, strict=True)]
    box = CompiledFunction([x, e.u, T], [*ends, e.certain])
    return box, CompiledFunction([x, e.u, e.phi], [e.rate + e.phi])


@pytest.mark.slow
@pytest.mark.parametrize("constant_input", [True, False])
@pytest.mark.parametrize("name", CASES)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_no_state_leaves_the_box(name, constant_input, seed):
    rng, (box, rate) = np.random.default_rng(seed), compiled(CASES[name], constant_input)
    x, T, steps = rng.uniform(-3, 3, len(CASES[name].states)), 0.1, 200
    corners = admissible_corners(Member("a", CASES[name], False))
    u = corners[rng.integers(len(corners))]
    low, high, certain = box(x, u, T)
    assert certain
    way = rng.choice([-1.0, 1.0], len(x)) * PHI / np.sqrt(len(x))
    for _ in range(steps):
        assert (low - 1e-9 <= x).all()
        assert (x <= high + 1e-9).all()
        x = x + T / steps * rate(x, u, way)[0]
        u = u if constant_input else corners[rng.integers(len(corners))]


@dataclass(frozen=True)
class Pushed(DoubleIntegrator):
    """A double integrator with another acceleration without inputs."""

    push: Callable[[ca.SX], ca.SX] = lambda x: ca.SX.zeros(2)

    def drift(self, x):
        return ca.vertcat(x[2:], self.push(x))


def pushed(push):
    return Pushed(2.0, 0.0, 2, push)


def test_a_box_that_cannot_be_shown_to_hold_the_state_is_not_certain():
    """A spring that would turn it eight times within the horizon."""
    box, _ = compiled(pushed(lambda x: -2500.0 * x[:2]), False)
    assert box(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(2), 1.0)[2] == 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_box_that_is_no_wider_than_its_start_for_rounding_is_not_certain(side):
    """Beyond 2^52 the next float64 is 1 m farther away, before it .5 m nearer."""
    box, _ = compiled(CASES["unicycle"], False)
    low, high, certain = box(np.array([side * 2.0**52, 0.0, 0.0]), np.zeros(2), 0.1)
    assert high[0] - low[0] == 0.5
    assert certain == 0.0


def test_a_margin_of_a_row_keeps_its_box():
    """Rows go by it: with another, trajectories would be others."""
    box, _ = compiled(DoubleIntegrator(2.0, 50.0, 2), False)
    assert box(np.array([0.0, 0.0, 20.0, 0.0]), np.zeros(2), 1.0)[2] == 0.0


DRAGGED = {
    "driven": pushed(lambda x: 0.5 * x[2:]),
    "weak": DoubleIntegrator(2.0, 0.3, 2),
    "strong": DoubleIntegrator(2.0, 50.0, 2),
    # A drag that has a largest force, and along each axis a push by the speed along the other.
    "sticking": pushed(lambda x: ca.vertcat(ca.sin(x[3]), ca.sin(x[2])) - ca.tanh(x[2:])),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", layered(DRAGGED, ("driven",)))
@given(seed=st.integers(0, 2**32 - 1), T=st.sampled_from([0.2, 1.0]))
@settings(max_examples=25, deadline=None)
def test_no_drag_is_too_strong_for_a_box_that_is_proven(name, seed, T):
    box, rate = compiled(DRAGGED[name], True, proven=True)
    rng, steps = np.random.default_rng(seed), 4000
    x, u = rng.uniform(-5, 5, 4), rng.uniform(-2, 2, 2)
    low, high, certain = box(x, u, T)
    assert certain
    way = rng.choice([-1.0, 1.0], 4) * PHI / 2
    for step in range(steps):
        assert (low - 1e-3 <= x).all()
        assert (x <= high + 1e-3).all()
        x = x + T / steps * rate(x, u, way)[0]
        way = rng.choice([-1.0, 1.0], 4) * PHI / 2 if step % 400 == 0 else way


@pytest.mark.parametrize("axis", [0, 1])
def test_what_slows_a_component_is_bounded_while_all_others_move(axis):
    """The speed along one axis pushes along the other, where there is a drag."""
    unit = ca.DM(np.eye(2)[axis])
    fed = pushed(lambda x: unit * (5.0 * x[3 - axis] - 0.1 * x[2 + axis]))
    box, rate = compiled(fed, True, proven=True)
    u = np.eye(2)[1 - axis] * 2.0
    _, high, certain = box(np.zeros(4), u, 1.0)
    x = np.zeros(4)
    for _ in range(1000):
        x = x + 1e-3 * rate(x, u, np.zeros(4))[0]
    assert certain
    assert 4.0 < x[2 + axis] <= high[2 + axis]


def test_the_slope_of_a_rate_that_jumps_bounds_nothing():
    """A drag, and a kick from 1 m/s along x on: its slope knows nothing of it."""
    kicked = pushed(lambda x: ca.vertcat(ca.if_else(x[2] > 1.0, 100.0, 0.0) - 0.1 * x[2], 0.0))
    box, rate = compiled(kicked, True, proven=True)
    x, u = np.array([0.0, 0.0, 0.9, 0.0]), np.array([2.0, 0.0])
    _, high, certain = box(x, u, 0.5)
    for _ in range(1000):
        x = x + 5e-4 * rate(x, u, np.zeros(4))[0]
    assert certain
    assert 40.0 < x[2] <= high[2]


def test_a_rate_that_is_no_number_makes_no_box_certain():
    """The difference of two numbers, each beyond float64 far from here."""
    box, _ = compiled(pushed(lambda x: ca.vertcat(ca.exp(x[0]) - ca.exp(x[1]), 0.0)), False)
    assert box(np.zeros(4), np.zeros(2), 0.1)[2] == 1.0
    assert box(np.array([1e3, 1e3, 0.0, 0.0]), np.zeros(2), 0.1)[2] == 0.0


def test_a_unicycle_is_never_faster_than_its_speed_and_an_integrator_may_be():
    unicycle = Member("a", Unicycle(4.0, 2.0), False)
    rates = fastest(unicycle, admissible_inputs(unicycle), 0.5)
    assert [float(r.hi) for r in rates] == pytest.approx([4.5, 4.5, 2.5], abs=1e-4)
    assert [float(r.lo) for r in rates] == pytest.approx([-4.5, -4.5, -2.5], abs=1e-4)
    double = Member("a", DoubleIntegrator(2.0), False)
    assert fastest(double, admissible_inputs(double), 0.5) is None


@dataclass(frozen=True)
class Needle(SingleIntegrator):
    """Inputs within a wedge, a thousand times as long as wide."""

    def input_polytope(self, x):
        return ca.SX([[-1e-3, 1.0], [-1e-3, -1.0], [1.0, 0.0]]), ca.SX([0.0, 0.0, 1.0])


def test_a_sharp_corner_of_u_reaches_as_far_as_actuators_let_it():
    """No farther than from any other place: 1e-5, although each face is but 1e-8 away there."""
    member = Member("a", Needle(1.0), False)
    tip = admissible_corners(member)[:, 0].min()
    assert -ACTUATION <= tip <= -0.5 * ACTUATION
    assert float(admissible_inputs(member)[0].lo) == tip


def test_corners_that_prove_something_lie_a_hair_beyond_those_of_rows():
    member = Member("a", SingleIntegrator(1.0), False)
    with outwards():
        proven = admissible_corners(member).max()
    beyond = (proven - 1.0) / (admissible_corners(member).max() - 1.0)
    assert beyond == pytest.approx(1.0 + 1e-6, rel=1e-8)


def test_inputs_whose_bounds_depend_on_the_state_are_refused():
    with pytest.raises(ValueError, match="do not depend on its state"):
        admissible_inputs(Member("a", Rail(), False))
