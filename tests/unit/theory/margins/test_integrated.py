"""The integrated bound by hand, and along trajectories of every dynamics and q."""

import math
from dataclasses import dataclass, replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples.bicycles import Bicycle
from examples.planar_quadrotors import PlanarQuadrotor
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.rounding import outwards
from phalanx.theory.margins.enclosure import Enclosure, admissible_inputs, enclose
from phalanx.theory.margins.integrated import (
    INFLATIONS,
    Growth,
    growth,
    keeps_chain,
    time_until_zero,
)
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.wheeled import DifferentialDrive, DynamicUnicycle, Unicycle
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import Linear, Power
from phalanx.theory.safety.composition import ComposedSet
from phalanx.theory.safety.obstacles import Sphere
from tests.unit.theory.users_own import Between, pair_of, runge_kutta, swarm_of

seeds = st.integers(0, 2**32 - 1)
PHI = [0.4, 0.7]
STEPS = 16

CASES = {
    "single integrators": (SingleIntegrator(1.5), [1.3], 0.05),
    "unicycles": (Unicycle(4.0, 2.0), [2.0], 0.05),
    "double integrators": (DoubleIntegrator(2.0, 0.5, 2), [0.6, 0.9], 0.1),
    "bicycles": (Bicycle(2.0, 0.7), [0.6, 0.9], 0.05),
    "triple integrators": (TripleIntegrator(2.0, 2), [0.6, 0.9, 1.1], 0.1),
    "differential drives": (DifferentialDrive(20.0, 0.1, 0.4), [2.0], 0.05),
    "dynamic unicycles": (DynamicUnicycle(4.0, 8.0, 0.25, 1.0, 4.0), [0.6, 0.9], 0.05),
    "planar quadrotors": (PlanarQuadrotor(4.0, 0.5), [0.6, 0.9, 1.1], 0.05),
}
KINDS = [(name, kind) for name, case in CASES.items() for kind in {0, len(case[1]) - 1}]


def enclosures(pair: ComposedSet, bounds: list[float], horizon: float) -> list[Enclosure]:
    """Enclosures of both members within the horizon; agent a holds its input."""
    return [
        enclose(m, pair.x[part], admissible_inputs(m) if l else None, bound, horizon, INFLATIONS)
        for l, (m, part, bound) in enumerate(zip(pair.members, pair.parts, bounds, strict=True))
    ]


class Case:
    """One pair, V = ψ_kind of it, its bound and its motion."""

    def __init__(self, name: str, kind: int, obstacle: bool) -> None:
        dynamics, alphas, self.horizon = CASES[name]
        obstacles = [Sphere((0.5, -0.5), 1.2)]
        pair = swarm_of([dynamics] * 2, obstacles=obstacles).composed.alone(int(obstacle))
        self.bounds = PHI[: len(pair.members)]
        V = build_chain(pair, alphas, None, self.bounds).psi[kind]
        moving = enclosures(pair, self.bounds, self.horizon)
        terms = list(growth(V, pair, 0, moving, self.bounds))
        self.bound = CompiledFunction([pair.x, moving[0].u], terms)
        u = ca.vertcat(*[e.u for e in moving])
        rates = ca.vertcat(*[e.rate for e in moving])
        f = ca.substitute(rates, u, 0 * u)
        remaining = ca.SX.sym("remaining")
        pull = ca.jacobian(V + remaining * (ca.jacobian(V, pair.x) @ f), pair.x)
        self.motion = CompiledFunction([pair.x, u], [rates])
        self.pull = CompiledFunction([pair.x, remaining], [pull, pull @ ca.jacobian(rates, u)])
        self.value = CompiledFunction([pair.x], [V])
        self.parts, self.size = pair.parts, pair.x.numel()
        self.corners = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", 9))).corners

    def trajectory(self, x, u, greedy, rng, excess=1.0):
        """V at the ends of STEPS steps, in each of which all inputs and φ are constant."""
        dt, values = self.horizon / STEPS, []
        for k in range(STEPS):
            pull, force = self.pull(x, self.horizon - k * dt)
            phi, inputs = np.zeros(self.size), u
            for l, part in enumerate(self.parts):
                way = pull[part] if greedy else rng.normal(size=len(pull[part]))
                phi[part] = excess * self.bounds[l] * way / (np.linalg.norm(way) + 1e-300)
            if len(self.parts) > 1:
                gains = self.corners @ force[len(u) :]
                best = np.argmax(gains) if greedy else rng.integers(len(gains))
                inputs = np.concatenate([u, self.corners[best]])
            x = runge_kutta(lambda y, u=inputs, phi=phi: self.motion(y, u)[0] + phi, x, dt)
            values.append(float(self.value(x)[0][0]))
        return np.array(values)

    def limits(self, x, u):
        """The bound at the ends of the steps, and whether it is proven."""
        value, rate, disturbance, bend, proven = (float(v[0]) for v in self.bound(x, u))
        t = self.horizon * np.arange(1, STEPS + 1) / STEPS
        return value + t * (rate + disturbance) + t * t / 2 * bend, proven


@cache
def case_of(name: str, kind: int, obstacle: bool) -> Case:
    return Case(name, kind, obstacle)


@pytest.mark.slow
@pytest.mark.parametrize("obstacle", [False, True])
@pytest.mark.parametrize(("name", "kind"), KINDS)
@given(seed=seeds, greedy=st.booleans())
@settings(max_examples=12)
def test_no_trajectory_rises_above_the_bound(name, kind, obstacle, seed, greedy):
    case, rng = case_of(name, kind, obstacle), np.random.default_rng(seed)
    x = rng.uniform(-2, 2, case.size)
    u = case.corners[rng.integers(len(case.corners))] * rng.uniform(0, 1)
    above, proven = case.limits(x, u)
    assert proven
    assert (case.trajectory(x, u, greedy, rng) <= above + 1e-9 * (1 + abs(above))).all()


@pytest.mark.parametrize(("name", "kind"), [(name, len(c[1]) - 1) for name, c in CASES.items()])
def test_a_disturbance_above_its_bound_breaks_it(name, kind, rng):
    case, broken = case_of(name, kind, False), 0
    for _ in range(20):
        x = rng.uniform(-2, 2, case.size)
        above, _ = case.limits(x, case.corners[0])
        broken += bool((case.trajectory(x, case.corners[0], True, rng, excess=6.0) > above).any())
    assert broken > 10


@pytest.mark.parametrize(
    ("value", "rate", "bend", "expected"),
    [
        (-0.6, 1.5, 10.0, 0.2),
        (-0.2, -1.5, 20.0, 0.2),
        (-0.1, 0.0, 0.0, 0.2),
        (-0.01, -0.5, 0.5, 0.2),
        (-1.0, -1.5, 0.0, 0.3),
        (0.0, 1.0, 1.0, 0.0),
        (0.0, -1.5, 20.0, 0.1),
        (0.25, -9.0, 0.0, 0.0),
        (-1.0, math.nan, 0.0, 0.0),
    ],
)
def test_the_time_until_zero_by_hand(value, rate, bend, expected):
    """A pair with D = .5 m²/s, and no bound beyond .3 s; a proof's time is a hair shorter."""

    def time(proven: float) -> float:
        bound = Growth(*map(ca.SX, (value, rate, 0.5, bend, proven)))
        return float(ca.DM(time_until_zero(bound, 0.3)))

    assert time(1.0) == pytest.approx(expected, rel=1e-12)
    assert time(0.0) == 0.0
    with outwards():
        shorter = time(1.0)
    assert shorter == pytest.approx(expected, rel=1e-12)
    assert shorter < time(1.0) or expected in (0.0, 0.3)


@pytest.mark.parametrize("bound", [0.0, 0.3])
def test_the_bend_of_two_single_integrators_is_what_inputs_and_disturbances_can_do(bound):
    """d/dt (2 (p_a - p_b)·w) with a at rest: 2 (w' + 2 φ / |w|)·w at most, where |w|² is 2."""
    pair = pair_of([SingleIntegrator(1.0)] * 2)
    e = enclosures(pair, [bound] * 2, 1e-3)
    bend = ca.Function("g", [pair.x, e[0].u], [growth(pair.h_tot, pair, 0, e, [bound] * 2).bend])
    needed = 2.0 * (2.0 + 2.0 * bound * np.sqrt(2.0))
    x = np.array([3.0, 0.0, 0.0, 0.0])
    assert needed <= float(bend(x, np.zeros(2))) <= 1.0001 * needed


@dataclass(frozen=True)
class Falling:
    """An α that is negative from .5 on: none of class K."""

    def value(self, s: ca.SX) -> ca.SX:
        return s * (0.5 - s)


@dataclass(frozen=True)
class Shifted:
    """An α with α(0) < 0: no class K."""

    def value(self, s: ca.SX) -> ca.SX:
        return s - 0.5


@pytest.mark.parametrize(
    ("h", "alpha", "ahead", "expected"),
    [
        (lambda s: -s, Linear(1.0), 1.0, 1),
        (lambda s: -s, Power(0.5, 3.0), 1.0, 1),
        (lambda s: -s, Shifted(), 1.0, 0),
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
def test_psi_keeps_h_only_where_every_part_of_the_argument_holds(h, alpha, ahead, expected):
    """h is a function of how far a is ahead of b."""
    double = [DoubleIntegrator(1.0, 0.0, 2)] * 2
    pair, smooth = (
        pair_of(double, Between(lambda a, b, h=h: h(a[0] - b[0]))) for h in (h, lambda s: -s)
    )
    e = enclosures(pair, [0.1, 0.1], 1e-3)
    chain = build_chain(smooth, [1.0, 1.0])
    chain = replace(chain, set=pair, psi=(pair.h_tot, chain.psi[1]))
    keeps = ca.Function("k", [pair.x, e[0].u], [keeps_chain(chain, [alpha, Linear(1.0)], e)])
    x = np.array([ahead, 0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 0.0])
    assert float(keeps(x, np.zeros(2))) == expected
