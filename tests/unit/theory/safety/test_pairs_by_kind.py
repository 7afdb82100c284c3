"""Pairs evaluated by kind, against the expressions of the whole swarm, pair by pair."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.chain import RelativeDegreeError
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere
from phalanx.theory.safety.pairs import SwarmPairs
from tests.unit.theory.sample_swarms import DEGREES, SPHERES, sample_swarm

seeds = st.integers(0, 2**32 - 1)
close = {"rel": 1e-12, "abs": 1e-12}


@cache
def swarm(name: str) -> tuple[ComposedSet, SwarmPairs, ca.Function]:
    """A swarm, its pairs, and what is expected of them."""
    composed, degree = sample_swarm(name), DEGREES[name]
    pairs = SwarmPairs(composed.members, composed.obstacles, composed.function, degree)
    return composed, pairs, expected(composed, degree)


def expected(composed: ComposedSet, degree: int) -> ca.Function:
    """x -> of every pair h, ..., L_f^q h; L_g L_f^{q-1} h of all inputs; all gradients."""
    x, parts, members = composed.x, composed.parts, composed.members
    f = ca.vertcat(*[m.dynamics.drift(x[p]) for m, p in zip(members, parts, strict=True)])
    g = ca.diagcat(*[m.dynamics.actuation(x[p]) for m, p in zip(members, parts, strict=True)])
    along = [composed.h]
    for _ in range(degree):
        along.append(ca.jtimes(along[-1], x, f))
    last = ca.jacobian(along[-2], x) @ g
    slopes = [ca.densify(ca.jacobian(value, x)) for value in along[:-1]]
    return ca.Function("expected", [x], [ca.horzcat(*along), ca.densify(last), *slopes])


def in_order(composed: ComposedSet, pairs: np.ndarray) -> list[int]:
    """The places of rows among the composed set's pairs."""
    return [composed.pairs.index((a, b)) for a, b in pairs.tolist()]


@pytest.mark.slow
@pytest.mark.parametrize("name", DEGREES)
@given(seed=seeds)
@settings(max_examples=8)
def test_every_pairs_numbers_are_those_of_its_own_expression(name, seed):
    composed, pairs, function = swarm(name)
    x = np.random.default_rng(seed).uniform(-3.0, 3.0, composed.x.numel())
    chosen = pairs.choose(pairs.every)
    order = in_order(composed, chosen.pairs)
    assert sorted(order) == list(range(len(composed.pairs)))
    along, forces, *slopes = [np.array(value)[order] for value in function(x)]
    jets = chosen.jets(x)
    assert jets.h == pytest.approx(along, **close)
    assert chosen.h(x) == pytest.approx(along[:, 0], **close)
    forces_of_pairs = np.zeros_like(forces)
    forces_of_pairs[chosen.force_pair, chosen.force_input] = jets.forces
    assert forces_of_pairs == pytest.approx(forces, **close)
    for value, gradients in zip(chosen.slopes(x), slopes, strict=True):
        forces_of_pairs = np.zeros_like(gradients)
        forces_of_pairs[chosen.slope_pair, chosen.slope_state] = value
        assert forces_of_pairs == pytest.approx(gradients, **close)


@pytest.mark.parametrize("name", DEGREES)
def test_a_pairs_bits_do_not_depend_on_pairs_evaluated_with_it(name):
    composed, pairs, _ = swarm(name)
    x = np.random.default_rng(1).uniform(-3.0, 3.0, (5, composed.x.numel()))
    chosen = pairs.choose(pairs.every)
    h, jets = chosen.h(x), chosen.jets(x)
    assert (h == jets.h[..., 0]).all()
    for k, pair in enumerate(chosen.pairs):
        alone = pairs.choose(pair[None])
        for state in range(len(x)):
            assert (alone.jets(x[state]).h[0] == jets.h[state, k]).all()
            assert (alone.jets(x[state]).forces == jets.forces[state, chosen.force_pair == k]).all()


def test_pairs_are_among_the_seen_alone():
    composed, pairs, _ = swarm("unicycles")
    pairs_in_sight = pairs.among((0, 2, 4), [1])
    assert pairs_in_sight.tolist() == [[0, 2], [0, 4], [2, 4], [0, 6], [2, 6]]
    chosen = pairs.choose(pairs_in_sight)
    x = np.full(composed.x.numel(), np.nan)
    for l in (0, 2, 4):
        x[composed.parts[l]] = l
    assert np.isfinite(chosen.jets(x).h).all()
    assert pairs.choose(pairs.among(())).jets(x).h.shape == (0, 2)
    assert pairs.choose(pairs.among((3, 4))).h(np.stack([x, x])).shape == (2, 0)


def test_what_is_compiled_does_not_grow_with_the_swarm():
    """Two agents of a sort and twenty need the same kinds, and obstacles share one."""
    few = [Member("n0", Unicycle(4.0, 2.0), False), Member("n1", Unicycle(4.0, 2.0), False)]
    foe = Member("a", Unicycle(2.0, 1.0), True)
    spheres = [Sphere((float(k), 0.0), 1.0 + k) for k in range(9)]
    for count in (1, 10):
        for around in (spheres[:1], spheres):
            swarm_pairs = SwarmPairs([*few * count, *[foe] * count], around, Separation(1.0), 1)
            assert len(swarm_pairs.kinds) == 2


class Picky:
    """Keeps more clear of spheres on the right: needs each one's numbers."""

    def between(self, a, b):
        return 1.0 - ca.sumsqr(a.p - b.p)

    def to_obstacle(self, a, obstacle):
        return self.extra.get(obstacle.center, 0.0) + obstacle.intrusion(a.p)

    extra = {(3.0, 1.0): 0.5}  # noqa: RUF012


def test_a_function_that_tells_spheres_apart_gets_each_of_them():
    """A table of its own that a sphere of symbols is not in."""
    members = [Member("n", SingleIntegrator(1.0), False)]
    composed = compose(members, SPHERES, Picky(), 1.0)
    pairs = SwarmPairs(members, SPHERES, Picky(), 1)
    x = np.array([0.3, -0.4])
    h = np.array(ca.Function("h", [composed.x], [composed.h])(x))[:, 0]
    chosen = pairs.choose(pairs.among([0]))
    assert chosen.h(x) == pytest.approx(h[in_order(composed, chosen.pairs)], **close)


def test_one_relative_degree_is_asked_for():
    """The same as of the whole swarm's chain."""
    point, heavy = SingleIntegrator(1.0), DoubleIntegrator(1.0, 0.0, 2)
    mixed = [Member("p", point, False), Member("d", heavy, True)]
    with pytest.raises(RelativeDegreeError, match="inputs of p appear in ψ_1, those of d only"):
        SwarmPairs(mixed, (), Separation(1.0), 1)
    points = [Member("p", point, False), Member("q", point, True)]
    with pytest.raises(RelativeDegreeError, match="expected 1 gains"):
        SwarmPairs(points, (), Separation(1.0), 2)
    heavier = [Member("p", heavy, False), Member("q", heavy, True)]
    with pytest.raises(RelativeDegreeError, match="above 1: give one"):
        SwarmPairs(heavier, (), Separation(1.0), 1)


def test_who_is_first_of_two_normal_members_decides_the_kind():
    """Only the pair in the swarm's order is built for a point and a unicycle."""
    members = [Member("p", SingleIntegrator(1.0), False), Member("u", Unicycle(1.0, 1.0), False)]
    assert len(SwarmPairs(members, (), Separation(1.0), 1).kinds) == 1
    assert len(SwarmPairs(members * 2, (), Separation(1.0), 1).kinds) == 4
