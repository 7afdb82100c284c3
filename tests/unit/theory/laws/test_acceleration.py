"""Laws of agents whose inputs are accelerations: tracking, and a chase that avoids its own side."""

import casadi as ca
import numpy as np
import pytest

from phalanx.scenario.load import load
from phalanx.swarm.swarm import build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.laws.goals import hold
from phalanx.theory.laws.law import View
from phalanx.theory.laws.tracking import output_chain
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from tests.unit.swarms import rows_of_scenario


def test_tracking_gives_the_output_the_wanted_acceleration_but_for_drag():
    law = build_swarm(load("formation3d")).law(0)
    chain = output_chain(DoubleIntegrator(2.0, 0.5, 3))
    assert law.gains == (2.0, 2.8284271247461903)
    x, u_nom = np.arange(6.0), np.array([0.3, -0.2, 1.0])
    evaluate = CompiledFunction([chain.x], [ca.vertcat(*chain.derivatives[:-1])])
    assert evaluate(x)[0] == pytest.approx(x)
    assert np.array(ca.DM(chain.input_for(ca.SX(u_nom)))).ravel() == pytest.approx(u_nom)
    assert output_chain(Unicycle(1.0, 1.0)).degree == 1
    assert output_chain(SingleIntegrator(1.0)).degree == 1


def test_a_chasing_adversary_avoids_another_adversary_in_its_way():
    """Adversary 4 chases agent 0 straight through adversary 5."""
    swarm = build_swarm(load("formation3d"))
    x = swarm.start()
    parts = swarm.safe_set.parts
    x[parts[0]] = [60.0, 0, 0, 0, 0, 0]
    x[parts[4]] = [50.0, 0, 0, 2.0, 0, 0]
    x[parts[5]] = [53.0, 0, 0, 0, 0, 0]
    terms, law = rows_of_scenario("formation3d").terms(4)(x), swarm.law(4)
    view = _view(swarm, 4, x, terms)
    guarded = law.input(view)
    assert guarded[0] < 0
    law._team = None
    assert law.input(view)[0] > 0


def _view(swarm, i, x, terms):
    states = {l: x[part] for l, part in enumerate(swarm.safe_set.parts)}
    return View(i, states, swarm.normal, hold(terms.positions[i]), terms, 0.0)
