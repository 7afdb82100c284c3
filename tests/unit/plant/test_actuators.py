"""Actuators take no input outside the polytope at the sampled state."""

import numpy as np
import pytest

from phalanx.plant.actuators import Actuators
from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from phalanx.wire.messages import Actuation, Sample
from tests.unit.swarms import swarm_of_scenario


def message(u: tuple[float, ...]) -> Actuation:
    return Actuation(k=0, t_apply=0.0, u=u)


def sample(x: np.ndarray) -> Sample:
    return Sample(k=0, t=0.0, x=x.astype("<f8").tobytes(), latest=(-1,) * 5)


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
    assert actuators.admissible(i, sample(np.zeros(15)), message(u=u)) == admitted


SHRINKING = '''
from dataclasses import dataclass
import casadi as ca

@dataclass(frozen=True)
class Shrinking:
    """A point whose speed bounds shrink away from the origin."""
    inputs: tuple[str, ...] = ("vx", "vy")
    states = ("x", "y")
    def drift(self, x): return ca.SX.zeros(2)
    def actuation(self, x): return ca.SX.eye(2)[:, :len(self.inputs)]
    def position(self, x): return x
    def input_polytope(self, x):
        m = len(self.inputs)
        b = 1 / (1 + x[0] ** 2) * ca.SX.ones(2 * m)
        return ca.vertcat(ca.SX.eye(m), -ca.SX.eye(m)), b
    def input_metric(self): return (1.0,) * len(self.inputs)

@dataclass
class Rest:
    """Wants to stay."""
    def prepare(self, dynamics): ...
    def input(self, view): ...
'''


@pytest.mark.parametrize("inputs", [["vx", "vy"], ["vx"]], ids=["two inputs", "one input"])
def test_an_actuator_whose_polytope_varies_is_held_to_the_one_at_the_sampled_state(
    inputs, tmp_path, monkeypatch
):
    (tmp_path / "shrinking_user.py").write_text(SHRINKING)
    monkeypatch.syspath_prepend(tmp_path)
    overrides = [
        f"agents.0.dynamics={{ type = 'shrinking_user:Shrinking', inputs = {inputs} }}",
        "agents.0.law={ type = 'shrinking_user:Rest' }",
        "agents.0.spread=[]",
    ]
    actuators = Actuators(build_swarm(load("unicycles", overrides)))
    x, rest = np.zeros(12), (0.0,) * (len(inputs) - 1)
    assert actuators.admissible(0, sample(x), message(u=(1.0, *rest)))
    x[0] = 3.0
    assert not actuators.admissible(0, sample(x), message(u=(1.0, *rest)))
    assert actuators.admissible(0, sample(x), message(u=(0.1, *rest)))
    x[0], x[2] = 0.0, 3.0
    assert actuators.admissible(0, sample(x), message(u=(1.0, *rest)))
