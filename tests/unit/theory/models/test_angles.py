"""Angles and headings are found in the equations and units, whatever the states are called."""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from phalanx_viewer.scene.model import Kinematics

from phalanx.guarantee.formula import workspace
from phalanx.scenario.load import load, read_table
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.models.aerial import IdentifiedQuadrotor, Quadrotor
from phalanx.theory.models.dynamics import angles, box_polytope, heading
from phalanx.theory.models.integrators import DoubleIntegrator, TripleIntegrator
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
