"""Goals in runs: agents reach them in every shipped dynamics, by their outputs and samples."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
import pytest

import phalanx
from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.schema.built_in import BUILT_IN
from phalanx.schema.registry import construct
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.laws.goals import Goal, hold
from phalanx.theory.models.dynamics import Dynamics
from tests.layers import layered
from tests.unit.tables import SPLIT, group, swarm_table

TRACKED: dict[str, tuple[dict[str, Any], list[float], int]] = {
    "unicycle": ({"speed": 2.0, "turn_rate": 2.0}, [], 1),
    "dynamic-unicycle": ({"acceleration": 2.0, "turn_acceleration": 8.0}, [1.0, 2.0], 2),
    "single-integrator": ({"speed": 2.0, "dimension": 2}, [], 1),
    "double-integrator": ({"acceleration": 2.0, "drag": 0.5, "dimension": 3}, [1.0, 2.0], 2),
    "triple-integrator": ({"jerk": 4.0, "dimension": 2}, [1.0, 3.0, 3.0], 3),
    "differential-drive": ({"wheel_rate": 20.0, "wheel_radius": 0.1, "track": 0.5}, [], 1),
    "quadrotor": ({"thrust": 5.0, "tilt": 0.5}, [8.0, 12.0, 6.0], 3),
    "identified-quadrotor": (
        {
            "thrust": 3.0,
            "tilt": 0.3,
            "thrust_lag": 0.1,
            "filter_lag": 0.05,
            "stiffness": 300.0,
            "damping": 20.0,
        },
        [150.0, 300.0, 50.0, 5.0],
        4,
    ),
}


def dynamics_of(name: str) -> Dynamics:
    return construct(Dynamics, {"type": name, **TRACKED[name][0]})


def axes_of(name: str) -> int:
    """Return the dimension of the space in which a dynamics moves."""
    dynamics = dynamics_of(name)
    return dynamics.position(ca.SX.sym("x", len(dynamics.states))).numel()


def scenario_of(name: str, start: list[list[float]], goal: list[Any]) -> dict[str, Any]:
    """Return a scenario of agents of one dynamics, far from an obstacle."""
    fields, gains, q = TRACKED[name]
    axes = axes_of(name)
    law = {"type": "track", "gains": gains} if gains else {"type": "track-velocity"}
    # What swings at 18 rad/s is not held for 50 ms.
    period = 0.01 if q == 4 else 0.05
    names = " ".join(f"a{place}" for place in range(len(start)))
    dynamics = {"type": name, **fields}
    return swarm_table(
        group(names, "normal", start, law=law, period=period, dynamics=dynamics, goal=goal),
        function="distance",
        radius=0.5,
        safety=SPLIT | {"alpha": [3.0] * q},
        duration=12.0,
        obstacles=[{"center": [100.0] * axes, "clearance": 1.0}],
    )


def last_positions(table: dict[str, Any]) -> np.ndarray:
    """Run a scenario; return the output points at its end, shape (N, d)."""
    run = phalanx.run(load(table), engine="in-process")
    return build_swarm(run.scenario).positions(run.recording.x[-1])


def test_every_shipped_dynamics_is_here():
    assert TRACKED.keys() == BUILT_IN[Dynamics].keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", layered(TRACKED, ("unicycle", "double-integrator")))
def test_an_agent_arrives_in_every_shipped_dynamics(name):
    point = [2.0, 1.0, -1.0][: axes_of(name)]
    rest = [0.0] * len(dynamics_of(name).states)
    (end,) = last_positions(scenario_of(name, [rest], [point]))
    assert end == pytest.approx(point, abs=0.1)


def test_a_restarted_agent_begins_its_waypoints_again():
    swarm = build_swarm(load("crossing"))
    first, nowhere = np.array([-2.25, 0.0, 0.0]), np.array([5.0, 0.0, 0.0])
    before, after = swarm.goal(3), swarm.goal(3)
    assert before(0.0, {3: first}).position.tolist() == [0.0, 6.0]
    assert before(1.0, {3: nowhere}).position.tolist() == [0.0, 6.0]
    assert after(1.0, {3: nowhere}).position.tolist() == [-2.0, 0.0]


@dataclass
class Circle:
    """A user's reference, right or wrong by its field."""

    kind: str
    axes: str = "xy"
    """Its own; of goals that ship it is their dimension."""

    def goal(self, sight):
        if self.kind == "flat":
            return hold(np.zeros(3))
        if self.kind == "list":
            return [1.0, 2.0]
        turned = np.array([np.cos(sight.t), np.sin(sight.t)])
        return Goal(turned, turned[::-1] * [-1.0, 1.0], -turned)

    def end(self):
        return None


@pytest.mark.slow
def test_a_users_reference_is_followed():
    circle = {"type": "tests.unit.swarm.test_goals:Circle", "kind": "right"}
    (end,) = last_positions(scenario_of("single-integrator", [[1.0, 0.0]], [circle]))
    assert end == pytest.approx([np.cos(12.0), np.sin(12.0)], abs=0.05)


@pytest.mark.parametrize("kind", ["flat", "list"])
def test_a_users_mistaken_reference_is_one_line_before_the_run(kind):
    circle = {"type": "tests.unit.swarm.test_goals:Circle", "kind": kind}
    swarm = build_swarm(load(scenario_of("single-integrator", [[1.0, 0.0]], [circle])))
    with pytest.raises(
        ScenarioError, match=r"points: Circle\.goal: expected a Goal .* for agent a0"
    ):
        require_runnable(swarm)
