"""The integrated bound holds along random and greedy trajectories, for every dynamics and q."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples.bicycles import Bicycle
from examples.planar_quadrotors import PlanarQuadrotor
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.margins.enclosure import admissible_inputs, enclose
from phalanx.theory.margins.integrated import (
    INFLATIONS,
    Growth,
    growth,
    keeps_chain,
    time_until_zero,
)
from phalanx.theory.models.integrators import (
    DoubleIntegrator,
    SingleIntegrator,
    TripleIntegrator,
)
from phalanx.theory.models.polytope import constant_polytope
from phalanx.theory.models.wheeled import (
    DifferentialDrive,
    DynamicUnicycle,
    Unicycle,
)
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.class_k import Linear, Power
from phalanx.theory.safety.composition import Member, compose
from phalanx.theory.safety.function import Separation
from phalanx.theory.safety.obstacles import Sphere

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


class Case:
    """One pair, V = ψ_kind of it, its bound and its motion."""

    def __init__(self, name: str, kind: int, obstacle: bool) -> None:
        dynamics, alphas, self.horizon = CASES[name]
        members = [Member("a", dynamics, False), Member("b", dynamics, True)]
        composed = compose(members, [Sphere((0.5, -0.5), 1.2)], Separation(1.0), 1.0)
        pair = composed.alone(1 if obstacle else 0)
        count = len(pair.members)
        self.bounds = PHI[:count]
        chain = build_chain(pair, alphas, None, self.bounds)
        moving = [
            enclose(
                m,
                pair.x[part],
                admissible_inputs(m) if l else None,
                bound,
                self.horizon,
                INFLATIONS,
            )
            for l, (m, part, bound) in enumerate(
                zip(pair.members, pair.parts, self.bounds, strict=True)
            )
        ]
        V = chain.psi[kind]
        self.bound = CompiledFunction(
            [pair.x, moving[0].u], list(growth(V, pair, 0, moving, self.bounds))
        )
        u = ca.vertcat(*[e.u for e in moving])
        rates = ca.vertcat(*[e.rate for e in moving])
        f = ca.substitute(rates, u, 0 * u)
        left = ca.SX.sym("left")
        pull = ca.jacobian(V + left * (ca.jacobian(V, pair.x) @ f), pair.x)
        self.motion = CompiledFunction([pair.x, u], [rates])
        self.pull = CompiledFunction([pair.x, left], [pull, pull @ ca.jacobian(rates, u)])
        self.value = CompiledFunction([pair.x], [V])
        self.parts, self.size = pair.parts, pair.x.numel()
        self.corners = constant_polytope(*dynamics.input_polytope(ca.SX.sym("x", 9))).corners

    def trajectory(self, x, u, greedy, rng, excess=1.0):
        """V at the ends of STEPS steps, in each of which all inputs and φ are constant."""
        dt, found = self.horizon / STEPS, []
        for k in range(STEPS):
            pull, force = self.pull(x, self.horizon - k * dt)
            phi, held = np.zeros(self.size), [u]
            for l, part in enumerate(self.parts):
                way = pull[part] if greedy else rng.normal(size=len(pull[part]))
                phi[part] = excess * self.bounds[l] * way / (np.linalg.norm(way) + 1e-300)
            if len(self.parts) > 1:
                gains = self.corners @ force[len(u) :]
                best = np.argmax(gains) if greedy else rng.integers(len(gains))
                held.append(self.corners[best])
            x = self._runge_kutta(x, np.concatenate(held), phi, dt)
            found.append(float(self.value(x)[0][0]))
        return np.array(found)

    def _runge_kutta(self, x, u, phi, dt):
        k1 = self.motion(x, u)[0] + phi
        k2 = self.motion(x + dt / 2 * k1, u)[0] + phi
        k3 = self.motion(x + dt / 2 * k2, u)[0] + phi
        k4 = self.motion(x + dt * k3, u)[0] + phi
        return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


@cache
def case_of(name: str, kind: int, obstacle: bool) -> Case:
    return Case(name, kind, obstacle)


def limits(case: Case, x, u):
    """The bound at the ends of the steps, and whether it is proven."""
    value, rate, disturbance, bend, known = (float(v[0]) for v in case.bound(x, u))
    t = case.horizon * np.arange(1, STEPS + 1) / STEPS
    return value + t * (rate + disturbance) + t * t / 2 * bend, known


@pytest.mark.slow
@pytest.mark.parametrize("obstacle", [False, True])
@pytest.mark.parametrize(("name", "kind"), KINDS)
@given(seed=seeds, greedy=st.booleans())
@settings(max_examples=12)
def test_no_trajectory_rises_above_the_bound(name, kind, obstacle, seed, greedy):
    case, rng = case_of(name, kind, obstacle), np.random.default_rng(seed)
    x = rng.uniform(-2, 2, case.size)
    u = case.corners[rng.integers(len(case.corners))] * rng.uniform(0, 1)
    above, known = limits(case, x, u)
    assert known
    found = case.trajectory(x, u, greedy, rng)
    assert (found <= above + 1e-9 * (1 + abs(above))).all()


@pytest.mark.parametrize(("name", "kind"), [(name, len(c[1]) - 1) for name, c in CASES.items()])
def test_a_disturbance_above_its_bound_breaks_it(name, kind, rng):
    case, broken = case_of(name, kind, False), 0
    for _ in range(20):
        x = rng.uniform(-2, 2, case.size)
        above, _ = limits(case, x, case.corners[0])
        found = case.trajectory(x, case.corners[0], True, rng, excess=6.0)
        broken += bool((found > above).any())
    assert broken > 10


@given(st.floats(-5, 0.5), st.floats(-20, 20), st.floats(0, 5), st.floats(0, 50), st.booleans())
def test_the_time_until_zero_is_where_the_parabola_crosses(value, rate, disturbance, bend, known):
    numbers = [value, rate, disturbance, bend, float(known)]
    time = float(ca.DM(time_until_zero(Growth(*map(ca.SX, numbers)), 0.3)))
    t = np.linspace(0, 0.3, 3001)
    curve = value + t * (rate + disturbance) + t * t / 2 * bend
    if not known or value > 0:
        assert time == 0
    else:
        assert (curve[t <= time] <= 1e-9).all()
        assert time == pytest.approx(0.3) or (curve[t > time * (1 + 1e-9) + 1e-4] > 0).all()


@pytest.mark.parametrize(
    ("value", "rate", "bend", "expected"),
    [
        (-0.6, 1.5, 10.0, 0.2),
        (-0.2, -1.5, 20.0, 0.2),
        (-1.0, 4.5, 0.0, 0.2),
        (-0.05, -0.5, 10.0, 0.1),
        (-1.0, -1.5, 0.0, 0.3),
        (0.0, 1.0, 1.0, 0.0),
    ],
)
def test_the_time_until_zero_by_hand(value, rate, bend, expected):
    """A pair with D = .5 m²/s, and no bound beyond .3 s."""
    time = time_until_zero(Growth(*map(ca.SX, (value, rate, 0.5, bend, 1.0))), 0.3)
    assert float(ca.DM(time)) == pytest.approx(expected, rel=1e-12)


class Shifted:
    """α(0) is below zero: no class K."""

    def value(self, s: ca.SX) -> ca.SX:
        return s - 0.5


@pytest.mark.parametrize(
    ("alpha", "holds"),
    [(Linear(0.6), True), (Power(0.5, 3.0), True), (Shifted(), False)],
)
def test_psi_counts_only_with_an_alpha_that_brings_h_back(alpha, holds):
    dynamics = DoubleIntegrator(2.0, 0.5, 2)
    members = [Member("a", dynamics, False), Member("b", dynamics, True)]
    pair = compose(members, [], Separation(1.0), 1.0).alone(0)
    chain = build_chain(pair, [alpha, Linear(1.0)], None, PHI)
    moving = [
        enclose(m, pair.x[part], admissible_inputs(m), 0.4, 0.5, INFLATIONS)
        for m, part in zip(members, pair.parts, strict=True)
    ]
    kept = CompiledFunction([pair.x], [keeps_chain(chain, [alpha, Linear(1.0)], moving)])
    assert kept(np.array([1.2, 0, 0, 0, 0, 0, 0, 0]))[0] == holds
    assert kept(np.array([0.8, 0, 0, 0, 0, 0, 0, 0]))[0] == 0
