"""Angles and headings are found in the equations and units, whatever the states are called."""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phalanx_viewer.scene.model import Kinematics

from phalanx.guarantee.formula import workspace
from phalanx.scenario.load import load, read_table
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.aerial import IdentifiedQuadrotor, Quadrotor
from phalanx.theory.models.dynamics import Bounded, Dynamics, angles, box_polytope, heading
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.wheeled import DifferentialDrive, DynamicUnicycle, Unicycle


@dataclass(frozen=True)
class Skater:
    """A unicycle of a user, without units, and with names of its own."""

    pace: float = 1.0
    states = ("bearing", "east", "north")
    inputs = ("glide", "turn")

    def drift(self, x):
        return ca.SX.zeros(3)

    def actuation(self, x):
        glide = ca.vertcat(0, ca.cos(x[0]), ca.sin(x[0]))
        return ca.horzcat(glide, ca.SX([1, 0, 0]))

    def position(self, x):
        return x[1:] + 0.25 * ca.vertcat(ca.cos(x[0]), ca.sin(x[0]))

    def input_polytope(self, x):
        return box_polytope((self.pace, 1.0))

    def input_metric(self):
        return (1.0, 1.0)


@pytest.mark.parametrize(
    ("dynamics", "turns", "expected"),
    [
        (Unicycle(speed=1.0, turn_rate=2.0), "theta", {"theta"}),
        (DynamicUnicycle(acceleration=1.0, turn_acceleration=2.0), "theta", {"theta"}),
        (DifferentialDrive(wheel_rate=9.0, wheel_radius=0.1, track=0.5), "theta", {"theta"}),
        (Skater(), "bearing", {"bearing"}),
        (Quadrotor(thrust=4.0, tilt=0.3), None, {"theta", "phi"}),
        (IdentifiedQuadrotor(4.0, 0.3, 0.1, 0.1, 100.0, 10.0), None, {"theta", "phi"}),
        (DoubleIntegrator(acceleration=1.0), None, set()),
        (TripleIntegrator(jerk=1.0, dimension=3), None, set()),
    ],
)
def test_the_heading_turns_the_velocity_and_a_tilt_does_not(dynamics, turns, expected):
    index = heading(dynamics)
    assert (index if index is None else dynamics.states[index]) == turns
    assert angles(dynamics) == expected


def test_a_quadrotor_is_drawn_along_its_velocity_whatever_its_pitch():
    composed = build_swarm(load("quadrotors")).safe_set
    x = np.zeros(composed.x.numel())
    x[3:9] = 0.0, 1.0, 0.0, 0.0, 0.5, 0.0  # north at 1 m/s, pitch 0.5
    np.testing.assert_array_equal(Kinematics(composed).poses(x).headings[0], [0.0, 1.0, 0.0])


def test_a_users_angle_is_drawn_and_bounded_by_any_name():
    table = read_table("unicycles")
    for group in table["agents"]:
        group["dynamics"] = {"type": f"{__name__}:Skater"}
    scenario = load(table)
    swarm = build_swarm(scenario)
    assert workspace(swarm) == ["east", "north"]  # bounds that the user has to give
    x = np.zeros(swarm.safe_set.x.numel())
    x[0] = math.pi / 2.0
    headings = Kinematics(swarm.safe_set).poses(x).headings
    np.testing.assert_allclose(headings[0], [0.0, 1.0, 0.0], atol=1e-12)


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
