"""The local margin covers every drift of a row until the next sample, or is beyond every row."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples.bicycles import Bicycle
from phalanx.guarantee.formula import Region, constants
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.margins.integrated import RowPart
from phalanx.theory.margins.local import UNKNOWN, local_margin
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Body, Separation
from phalanx.theory.safety.obstacles import Sphere

seeds = st.integers(0, 2**32 - 1)
PHI = [0.4, 0.7]


CASES = {
    "single integrators": (SingleIntegrator(1.5), [1.3], 0.05),
    "unicycles": (Unicycle(4.0, 2.0), [2.0], 0.012),
    "double integrators": (DoubleIntegrator(2.0, 0.5, 2), [0.6, 0.9], 0.05),
    "bicycles": (Bicycle(2.0, 0.7), [0.6, 0.9], 0.02),
}


def field_of(member: Member):
    x = ca.SX.sym("x", len(member.dynamics.states))
    u = ca.SX.sym("u", len(member.dynamics.inputs))
    rate = member.dynamics.drift(x) + member.dynamics.actuation(x) @ u
    return CompiledFunction([x, u], [rate])


class Pair:
    """Two agents, the second perhaps an adversary, with the row of the first."""

    def __init__(self, name: str, part: RowPart) -> None:
        dynamics, alphas, self.horizon = CASES[name]
        members = [Member("a", dynamics, False), Member("b", dynamics, part is RowPart.WHOLE)]
        self.set = compose(members, [], Separation(1.0), 1.0)
        chain = build_chain(self.set, alphas, None, PHI)
        self.n, self.m = len(dynamics.states), len(dynamics.inputs)
        self.corners = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", self.n))).corners
        u, w = ca.SX.sym("u", self.m), ca.SX.sym("w", self.m)
        row = chain.actuation[0] @ u + part.value * (ca.sum1(chain.drift) + chain.alpha)
        if part is RowPart.WHOLE:
            row += chain.actuation[1] @ w
        outputs = [self.set.substitute(e) for e in (row, part.value * chain.disturbance)]
        self.row = CompiledFunction([self.set.x, u, w], outputs)
        margin = local_margin(chain, 0, self.horizon, PHI, part)
        self.margin = CompiledFunction([self.set.x], [margin])
        self.field = field_of(members[0])


@cache
def pair_of(name: str, part: RowPart) -> Pair:
    return Pair(name, part)


@pytest.mark.slow
@pytest.mark.parametrize("part", RowPart)
@pytest.mark.parametrize("name", CASES)
@given(seed=seeds)
@settings(max_examples=15, deadline=None)
def test_the_local_margin_covers_every_drift_of_the_row_until_the_next_sample(name, part, seed):
    """Compare with trajectories whose inputs and disturbances are drawn again all the time."""
    pair, rng = pair_of(name, part), np.random.default_rng(seed)
    x = rng.uniform(-3, 3, 2 * pair.n)
    margin = float(pair.margin(x)[0][0])
    corners = pair.corners
    u, w = (corners[rng.integers(len(corners))] for _ in range(2))
    before = float(pair.row(x, u, w)[0][0])
    steps = 20
    for _ in range(steps):
        phi = [bound * unit(rng, pair.n) for bound in PHI]
        other = corners[rng.integers(len(corners))]
        rates = [pair.field(x[: pair.n], u)[0] + phi[0], pair.field(x[pair.n :], other)[0] + phi[1]]
        x = x + pair.horizon / steps * np.concatenate(rates)
        row, disturbance = (float(v[0]) for v in pair.row(x, u, w))
        assert row - before + disturbance <= margin


def unit(rng: np.random.Generator, n: int) -> np.ndarray:
    v = rng.normal(size=n)
    return v / np.linalg.norm(v)


def test_without_an_enclosure_the_margin_is_beyond_every_row():
    """A bicycle that may turn by many radians before it samples again."""
    members = [Member("a", Bicycle(50.0, 50.0, 0.01), False)]
    composed = compose(members, [Sphere((5.0, 0.0), 1.0)], Separation(1.0), 1.0)
    chain = build_chain(composed, [1.0, 1.0], None, [1.0])
    margin = CompiledFunction([composed.x], [local_margin(chain, 0, 10.0, [1.0], RowPart.WHOLE)])
    assert margin(np.array([0.0, 0.0, 0.0, 20.0]))[0][0] > 1e20


class Kinked:
    """h = 1 - d_y + |d_x|, with d = p_a - p_b: its gradient jumps where d_x = 0."""

    def between(self, a: Body, b: Body) -> ca.SX:
        apart = a.p - b.p
        return 1.0 - apart[1] + ca.fabs(apart[0])


def test_there_is_no_margin_where_a_kink_of_h_is_within_reach():
    """Across it L_g h jumps, which no rate of it bounds."""
    members = [Member(name, SingleIntegrator(1.0), False) for name in "ab"]
    chain = build_chain(compose(members, [], Kinked(), 1.0), [1.0], None, [0.0, 0.0])
    margin = CompiledFunction(
        [chain.set.x], [local_margin(chain, 0, 0.1, [0.0, 0.0], RowPart.HALF)]
    )
    assert margin(np.array([0.15, 0.0, 0.0, 0.0]))[0] == UNKNOWN
    assert margin(np.array([0.35, 0.0, 0.0, 0.0]))[0] < 1.0
    low, high = np.full(4, -1.0), np.full(4, 1.0)
    found = constants(chain, Region(low, high, np.zeros((1, 4))), [0.0, 0.0])
    assert found["c_g"].how == "sampled"
    with pytest.raises(ValueError, match="is not a number"):
        constants(chain, Region(low, high, np.full((1, 4), np.nan)), [0.0, 0.0])


class Zone:
    """h = 3 inside a disc and -1 outside: its derivative is zero wherever there is one."""

    def between(self, a: Body, b: Body) -> ca.SX:
        return ca.if_else(ca.sumsqr(a.p - b.p) < 1.0, 3.0, -1.0) + 1e-3 * (a.p[0] - b.p[0])


class Bearing:
    """h = |bearing of b from a| - 3: at ±π the bearing jumps, its derivative does not."""

    def between(self, a: Body, b: Body) -> ca.SX:
        apart = b.p - a.p
        return ca.atan2(apart[1], apart[0]) - 3.0


class ThinWall:
    """h = 1 on the millimetres where x_a and x_b round to one number, else -1, and a slope."""

    def between(self, a: Body, b: Body) -> ca.SX:
        same = ca.floor(1000.0 * a.p[0]) == ca.floor(1000.0 * b.p[0])
        return 2.0 * same - 1.0 + 1e-3 * (a.p[1] - b.p[1])


@pytest.mark.parametrize(
    ("function", "near", "far"),
    [
        (Zone(), [1.05, 0.0, 0.0, 0.0], [3.0, 0.0, 0.0, 0.0]),
        (Bearing(), [1.0, 0.01, 0.0, 0.0], [-1.0, 0.01, 0.0, 0.0]),
        (ThinWall(), [0.0105, 2.0, 0.0, 0.0], None),
    ],
    ids=["zone", "bearing", "thin wall"],
)
@pytest.mark.parametrize("part", RowPart)
def test_there_is_no_margin_where_h_itself_can_jump(function, near, far, part):
    members = [Member(name, SingleIntegrator(1.0), False) for name in "ab"]
    chain = build_chain(compose(members, [], function, 1.0), [1.0], None, [0.0, 0.0])
    margin = CompiledFunction([chain.set.x], [local_margin(chain, 0, 0.1, [0.0, 0.0], part)])
    assert margin(np.array(near))[0] == UNKNOWN == np.inf
    assert far is None or margin(np.array(far))[0] < 100.0


def test_a_margin_of_micrometres_is_not_taken_for_an_unknown_one():
    """Keep margins of 1e13 and more, which a row in units of 1e-9 m has."""
    members = [Member(name, SingleIntegrator(1e7), False) for name in "ab"]
    chain = build_chain(compose(members, [], Separation(1e9), 1.0), [1.0], None, [0.0, 0.0])
    margin = CompiledFunction(
        [chain.set.x], [local_margin(chain, 0, 0.1, [0.0, 0.0], RowPart.HALF)]
    )
    assert 1e12 < margin(np.array([2e9, 0.0, 0.0, 0.0]))[0] < np.inf
