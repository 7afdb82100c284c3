"""Mistakes found at x(0), for any number of agents and any sensing radius."""

import sys

import pytest

from phalanx.scenario.load import load
from phalanx.scenario.model import ScenarioError
from phalanx.swarm.runnable import require_runnable
from phalanx.swarm.swarm import Swarm, build_swarm
from tests.unit.tables import group, swarm_table

MODULE = """
from dataclasses import dataclass

import casadi as ca

from phalanx.extend import SingleIntegrator

@dataclass(frozen=True)
class Tiring(SingleIntegrator):
    def input_polytope(self, x):
        A, b = super().input_polytope(x)
        return A, b / (1 + x[0] ** 2)

@dataclass(frozen=True)
class Touchy:
    def between(self, a, b):
        return 1 - ca.log(ca.sumsqr(a.p - b.p) - 1)
    def to_obstacle(self, a, obstacle):
        return obstacle.clearance - ca.norm_2(a.p - obstacle.center)
"""
COUNT = 60


@pytest.fixture
def many(tmp_path, monkeypatch):
    (tmp_path / "many_own.py").write_text(MODULE)
    monkeypatch.chdir(tmp_path)
    names = " ".join(f"a{k}" for k in range(COUNT))
    points = [[2.0 * k, 0.0] for k in range(COUNT - 1)]
    points.append([points[-1][0] + 0.9, 0.0])  # nearer to the one before it than any other two
    agents = [group(names, "normal", points), group("far", "adversary", [[0.0, 100.0]])]
    safety = {"eta": 0.1, "composition": "pairs", "neighbourhood": 3.0}
    table = swarm_table(*agents, function="distance", radius=0.5, safety=safety)
    yield lambda *overrides: build_swarm(load(table, overrides))
    sys.modules.pop("many_own", None)


def refused(swarm: Swarm) -> str:
    with pytest.raises(ScenarioError) as error:
        require_runnable(swarm)
    return str(error.value)


def test_a_swarm_in_which_no_agent_sees_all_others_can_run(many):
    require_runnable(many())


def test_an_h_that_is_not_finite_is_found_in_the_last_of_all_pairs(many):
    pair = f"h of a{COUNT - 2} and a{COUNT - 1}"
    assert pair in refused(many("safety.function={ type = 'many_own:Touchy' }"))


def test_a_misfit_is_found_in_an_agent_out_of_sight(many):
    own = "agents.1.dynamics={ type = 'many_own:Tiring', speed = 1.0 }"
    assert "input bounds of far that do not depend on its state" in refused(many(own))
