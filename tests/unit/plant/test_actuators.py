"""Actuators take no input outside the polytope at the sampled state."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from phalanx_plant.world.world import Actuators

from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from tests.unit.swarms import swarm_of_scenario


@pytest.mark.parametrize(
    ("i", "u", "admitted"),
    [
        (0, (4.0, 2.0), True),
        (0, (-4.0, -2.0), True),
        (0, (4.001, 0.0), False),
        (0, (0.0, -2.001), False),
        (3, (2.0, 1.0), True),
        (3, (4.0, 0.0), False),
        (3, (0.0, 1.5), False),
        (0, (float("nan"), 0.0), False),
    ],
)
def test_an_actuator_takes_no_input_outside_its_polytope(i, u, admitted):
    actuators = Actuators(swarm_of_scenario("unicycles"))
    assert actuators.takes(i, np.zeros(3), np.array(u)) == admitted


@dataclass(frozen=True)
class Point:
    """A point that moves as its inputs say."""

    inputs: tuple[str, ...] = ("vx", "vy")
    states = ("x", "y")

    def drift(self, x):
        return ca.SX.zeros(2)

    def actuation(self, x):
        return ca.SX.eye(2)[:, : len(self.inputs)]

    def position(self, x):
        return x

    def input_metric(self):
        return (1.0,) * len(self.inputs)


@dataclass(frozen=True)
class Shrinking(Point):
    """Its speed bounds shrink away from the origin."""

    def input_polytope(self, x):
        m = len(self.inputs)
        return ca.vertcat(ca.SX.eye(m), -ca.SX.eye(m)), 1 / (1 + x[0] ** 2) * ca.SX.ones(2 * m)


@dataclass(frozen=True)
class Needle(Point):
    """It goes ahead at up to 1, or at more with next to no angle between its bounds."""

    angle: float = 1e-4
    varying: bool = False

    def input_polytope(self, x):
        A = ca.SX([[self.angle, 1.0], [self.angle, -1.0], [-1.0, 0.0]])
        scale = 100.0 + x[0] ** 2 if self.varying else 100.0
        return scale * A, scale * ca.SX([0.0, 0.0, 1.0])


@dataclass
class Rest:
    """Wants to stay."""

    def prepare(self, dynamics): ...

    def input(self, view): ...


def actuators_of(kind: str, **fields) -> Actuators:
    overrides = {
        "agents.0.dynamics": {"type": f"{__name__}:{kind}", **fields},
        "agents.0.law": {"type": f"{__name__}:Rest"},
        "agents.0.spread": [],
    }
    return Actuators(build_swarm(load("unicycles", overrides)))


@pytest.mark.parametrize("inputs", [["vx", "vy"], ["vx"]], ids=["two inputs", "one input"])
def test_an_actuator_whose_polytope_varies_is_held_to_the_one_at_the_sampled_state(inputs):
    actuators = actuators_of("Shrinking", inputs=inputs)
    x, rest = np.zeros(2), (0.0,) * (len(inputs) - 1)
    assert actuators.takes(0, x, np.array((1.0, *rest)))
    x[0] = 3.0
    assert not actuators.takes(0, x, np.array((1.0, *rest)))
    assert actuators.takes(0, x, np.array((0.1, *rest)))
    x[:] = 0.0, 3.0
    assert actuators.takes(0, x, np.array((1.0, *rest)))


@pytest.mark.parametrize("varying", [False, True])
def test_beyond_the_point_of_a_needle_an_actuator_admits_no_more_than_beyond_a_face(varying):
    """(0.09, 0) is 1e-5 above both rows of the point, and a hand's breadth from the polytope."""
    actuators, x = actuators_of("Needle", varying=varying), np.zeros(2)
    assert actuators.takes(0, x, np.array((0.0, 0.0)))
    assert actuators.takes(0, x, np.array((-1.0, 1e-4)))
    assert actuators.takes(0, x, np.array((9e-6, 0.0)))
    assert not actuators.takes(0, x, np.array((2e-5, 0.0)))
    assert not actuators.takes(0, x, np.array((0.09, 0.0)))
