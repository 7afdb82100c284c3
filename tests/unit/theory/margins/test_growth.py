"""The parts of a pair's bound, each by hand: the bend g, and when ψ_{q-1} keeps h."""

import casadi as ca
import numpy as np
import pytest

from phalanx.theory.margins.enclosure import admissible_inputs, enclose
from phalanx.theory.margins.integrated import INFLATIONS, growth, keeps_chain
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.function import Body, Separation
from phalanx.theory.safety.obstacles import Obstacle

HORIZON = 1e-3


def pair_of(dynamics, function) -> ComposedSet:
    members = [Member("a", dynamics, False), Member("b", dynamics, True)]
    return compose(members, [], function, 1.0).alone(0)


def moving(pair: ComposedSet, bound: float) -> list:
    """Enclosures of both agents within the horizon; agent a holds its input."""
    own = (None, admissible_inputs(pair.members[1]))
    return [
        enclose(member, pair.x[part], inputs, bound, HORIZON, INFLATIONS)
        for member, part, inputs in zip(pair.members, pair.parts, own, strict=True)
    ]


@pytest.mark.parametrize("bound", [0.0, 0.3])
def test_the_bend_of_two_single_integrators_is_what_inputs_and_disturbances_can_do(bound):
    """d/dt (2 (p_a - p_b)·w) with a at rest: 2 (w' + 2 φ / |w|)·w at most, where |w|² is 2."""
    pair = pair_of(SingleIntegrator(1.0), Separation(1.0))
    e = moving(pair, bound)
    bend = ca.Function("g", [pair.x, e[0].u], [growth(pair.h_tot, pair, 0, e, [bound] * 2).bend])
    found = float(bend(np.array([3.0, 0.0, 0.0, 0.0]), np.zeros(2)))
    needed = 2.0 * (2.0 + 2.0 * bound * np.sqrt(2.0))
    assert needed <= found <= 1.0001 * needed


class Along:
    """h is a function of how far a is ahead of b."""

    def __init__(self, h) -> None:
        self._h = h

    def between(self, a: Body, b: Body) -> ca.SX:
        return self._h(a.p[0] - b.p[0])

    def to_obstacle(self, a: Body, obstacle: Obstacle) -> ca.SX:
        return obstacle.intrusion(a.p)


class Falling:
    """An α that is negative from .5 on: none of class K."""

    def value(self, s: ca.SX) -> ca.SX:
        return s * (0.5 - s)


@pytest.mark.parametrize(
    ("h", "alpha", "ahead", "kept"),
    [
        (lambda s: -s, Linear(1.0), 1.0, 1),
        (lambda s: -s, Linear(1.0), 0.0, 1),
        (lambda s: -s, Linear(1.0), -1e-9, 0),  # unsafe already
        (lambda s: -s - 1.0 / s**2, Linear(1.0), 1.0, 1),
        (lambda s: -2.0 - ca.sqrt(ca.fabs(s)), Linear(1.0), 1.0, 1),
        (lambda s: -2.0 - ca.sqrt(ca.fabs(s)), Linear(1.0), 0.0, 0),  # h' has no bound at 0
        (lambda s: -2.0 + ca.sign(s), Linear(1.0), 1.0, 1),
        (lambda s: -2.0 + ca.sign(s), Linear(1.0), 0.0, 0),  # h jumps at 0
        (lambda s: -s, Falling(), 0.0, 1),  # h cannot get as far as .5
        (lambda s: -600.0 * s, Falling(), 0.0, 0),  # here it can
    ],
)
def test_psi_keeps_h_only_where_every_part_of_the_argument_holds(h, alpha, ahead, kept):
    pair = pair_of(DoubleIntegrator(1.0, 0.0, 2), Along(h))
    bounds = (0.1, 0.1)
    e = moving(pair, bounds[0])
    chain = build_chain(pair_of(DoubleIntegrator(1.0, 0.0, 2), Along(lambda s: -s)), [1.0, 1.0])
    chain = type(chain)(pair, (pair.h_tot, chain.psi[1]), *list(vars(chain).values())[2:])
    found = ca.Function("k", [pair.x, e[0].u], [keeps_chain(chain, [alpha, Linear(1.0)], e)])
    x = np.array([ahead, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    assert float(found(x, np.zeros(2))) == kept
