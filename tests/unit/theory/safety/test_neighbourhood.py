"""The neighbourhood: which pairs count for an agent at a state."""

import numpy as np
import pytest

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import FAR, Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere, Wall
from tests.unit.theory.whole_expression import SetInSight, TermsFunction, in_sight

R, RHO, A1 = 1.3, 0.7, 0.8


def test_what_lies_outside_the_neighbourhood_has_no_part_in_h_tot():
    """Agent 2 is in trouble far away, between an attacker and an obstacle; agent 0 is not."""
    members = [Member(f"a{i}", SingleIntegrator(1.0), i == 1) for i in range(3)]
    obstacles = [Sphere((40.0, 0.0), 2.0), Wall((0.0, 1.0), 5.0), Sphere((0.0, -4.0), 2.0)]
    composed = compose(members, obstacles, Separation(R), RHO)
    x = np.array([0.0, 0.0, 40.5, 0.0, 39.8, 0.0])
    near = TermsFunction(build_chain(in_sight(composed, 0, 10.0), [A1]))(x)
    pairs = np.array([-5.0, 4.0 - 16.0])
    assert near.psi == pytest.approx(np.log(np.sum(np.exp(RHO * pairs))) / RHO)
    assert near.c[1] == pytest.approx([0.0, 0.0])
    assert near.c[2] == pytest.approx([0.0, 0.0])
    assert TermsFunction(build_chain(composed, [A1]))(x).psi[0] > 0


def test_an_agent_alone_in_its_neighbourhood_is_safe_and_free():
    members = [Member("a", SingleIntegrator(1.0), False), Member("b", SingleIntegrator(1.0), True)]
    composed = compose(members, [], Separation(R), RHO)
    terms = TermsFunction(build_chain(in_sight(composed, 0, 1.0), [A1]))
    alone = terms(np.array([0.0, 0.0, 5.0, 0.0]))
    assert alone.psi == pytest.approx([FAR])
    assert alone.unforced < 0
    assert np.concatenate(list(alone.c.values())) == pytest.approx(np.zeros(4))


def test_the_neighbourhood_counts_pairs_among_neighbours_too():
    members = [Member(f"a{i}", SingleIntegrator(1.0), False) for i in range(3)]
    composed = in_sight(compose(members, [], Separation(R), RHO), 0, 2.0)
    assert isinstance(composed, SetInSight)
    active = CompiledFunction([composed.x], [composed.near])
    assert active(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 1.9]))[0].tolist() == [1, 1, 1]
    assert active(np.array([0.0, 0.0, 1.0, 0.0, 0.0, 2.1]))[0].tolist() == [1, 0, 0]
