"""ψ-chains of every relative degree, against finite differences and hand formulas."""

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from examples.bicycles import Bicycle
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.dynamics import Dynamics
from phalanx.theory.models.integrators import DoubleIntegrator, SingleIntegrator, TripleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.chain import RelativeDegreeError, build_chain
from phalanx.theory.safety.class_k import Linear, Power
from phalanx.theory.safety.obstacles import Sphere, Wall
from tests.unit.theory.users_own import (
    Case,
    Drifter,
    OutputUnicycle,
    Oval,
    along,
    pair_of,
    swarm_of,
)
from tests.unit.theory.whole_expression import TermsFunction

XI = 2.5
ALPHAS = (Power(0.5, 3.0), Linear(1.7), Linear(1.1))
SWARMS: dict[str, tuple[int, Callable[[], Case]]] = {
    "single integrators": (
        1,
        lambda: swarm_of([SingleIntegrator(1.0)] * 4, adversaries=2, rho=5.0),
    ),
    "a mixture": (
        1,
        lambda: swarm_of(
            [Unicycle(1.0, 1.0, 0.4), Drifter(), SingleIntegrator(1.0), OutputUnicycle()],
            function=Oval(2.0, 1.0),
        ),
    ),
    "double integrators": (
        2,
        lambda: swarm_of(
            [DoubleIntegrator(3.0, drag, 2) for drag in (0.7, 0.2, 0.7)], function=Oval(), rho=1.5
        ),
    ),
    "bicycles": (2, lambda: swarm_of([Bicycle(1.0, 1.0, 0.4)] * 2, rho=1.0)),
    "triple integrators": (
        3,
        lambda: swarm_of(
            [TripleIntegrator(1.0, 3)] * 3, obstacles=[Sphere((0.5, 0.1, -0.3), 0.8)], rho=0.7
        ),
    ),
}
seeds = st.integers(0, 2**32 - 1)
close = {"rel": 1e-8, "abs": 1e-10}


@cache
def chain_of(name: str) -> tuple[Case, TermsFunction, CompiledFunction]:
    """One of the swarms, the terms of its chain, and the chain alone."""
    degree, build = SWARMS[name]
    case = build()
    chain = build_chain(case.composed, ALPHAS[:degree], XI)
    assert chain.relative_degree == degree
    psi = case.composed.substitute(ca.vertcat(*chain.psi))
    return case, TermsFunction(chain), CompiledFunction([case.composed.x], [psi])


@pytest.mark.slow
@pytest.mark.parametrize("name", SWARMS)
@given(seed=seeds)
@settings(max_examples=10)
def test_each_psi_is_the_slope_of_the_one_before_along_f_and_alpha_of_it(name, seed):
    """ψ_0 is h_tot, ξ counts in ψ_1 alone, and inputs act on ψ_q by the columns of g."""
    case, function, psi_of = chain_of(name)
    twin = case.twin
    x = np.random.default_rng(seed).uniform(-2.0, 2.0, case.composed.x.numel())
    terms, drift = function(x), sum(twin.f(l, x) for l in range(len(twin.members)))
    assert terms.psi[0] == pytest.approx(twin.h_tot(x))
    expected = []
    for k, alpha in enumerate(ALPHAS[: len(terms.psi)]):
        slope = along(lambda y, k=k: psi_of(y)[0][k], x, drift)
        expected.append(slope + float(alpha.value(terms.psi[k])))
    expected[0] += XI if len(expected) > 1 else 0.0
    assert [*terms.psi[1:], terms.unforced] == pytest.approx(expected, rel=1e-4, abs=1e-4)
    for l, c in terms.c.items():
        slopes = [along(lambda y: psi_of(y)[0][-1], x, column) for column in twin.g(l, x).T]
        assert c == pytest.approx(slopes, rel=1e-4, abs=1e-5)
        assert terms.positions[l] == pytest.approx(twin.position(l, x))


@cache
def terms_of_pair(dynamics: Dynamics, *alphas: float) -> TermsFunction:
    return TermsFunction(build_chain(pair_of([dynamics] * 2), alphas, XI))


A1, A2, B, BETA = 0.8, 1.7, 0.25, 2 / 3


@given(seed=seeds)
def test_unicycles_are_the_hand_formula(seed):
    x = np.random.default_rng(seed).uniform(-2.0, 2.0, 6)
    heads = [np.array([np.cos(t), np.sin(t)]) for t in (x[2], x[5])]
    lefts = [np.array([-np.sin(t), np.cos(t)]) for t in (x[2], x[5])]
    d = x[:2] + B * heads[0] - x[3:5] - B * heads[1]
    terms = terms_of_pair(Unicycle(4.0, 2.0, B), A1)(x)
    assert terms.psi == pytest.approx([1.0 - d @ d], **close)
    assert terms.unforced == pytest.approx(A1 * (1.0 - d @ d), **close)
    assert terms.c[0] == pytest.approx([-2 * d @ heads[0], -2 * B * d @ lefts[0]], **close)
    assert terms.c[1] == pytest.approx([2 * d @ heads[1], 2 * B * d @ lefts[1]], **close)


@pytest.mark.parametrize("n", [2, 3])
@given(seed=seeds)
def test_double_integrators_with_drag_are_the_hand_formula(n, seed):
    x = np.random.default_rng(seed).uniform(-2.0, 2.0, 4 * n)
    d, v = x[:n] - x[2 * n : 3 * n], x[n : 2 * n] - x[3 * n :]
    h = 1.0 - d @ d
    psi_1 = -2 * d @ v + XI + A1 * h
    terms = terms_of_pair(DoubleIntegrator(2.0, BETA, n), A1, A2)(x)
    assert terms.psi == pytest.approx([h, psi_1], **close)
    unforced = -2 * v @ v + 2 * BETA * d @ v - 2 * A1 * d @ v + A2 * psi_1
    assert terms.unforced == pytest.approx(unforced, **close)
    assert terms.c[0] == pytest.approx(-2 * d, **close)
    assert terms.c[1] == pytest.approx(2 * d, **close)


def test_the_corrected_row_bounds_the_disturbance_in_psi_1_and_the_printed_one_forgets_it(rng):
    """D_2 = Σ ‖∂ψ_1/∂x_l‖ φ_l^max; for one pair ∂ψ_1/∂x_a = (-2 V - 2 α_1 D, -2 D)."""
    pair, phi = pair_of([DoubleIntegrator(2.0, 0.5, 2)] * 2), [0.4, 0.7]
    assert build_chain(pair, [A1, A2], XI).disturbance.is_zero()
    chain = build_chain(pair, [A1, A2], XI, phi)
    disturbance = CompiledFunction([pair.x], [chain.disturbance])
    for x in rng.uniform(-3, 3, (30, 8)):
        d, v = x[:2] - x[4:6], x[2:4] - x[6:]
        slope = np.linalg.norm(np.concatenate([-2 * v - 2 * A1 * d, -2 * d]))
        assert disturbance(x)[0] == pytest.approx([slope * sum(phi)], rel=1e-6)


def test_a_wall_is_a_half_plane_and_its_normal_needs_no_length():
    agent = [SingleIntegrator(1.0)]
    case = swarm_of(agent, adversaries=0, obstacles=[Wall((0.0, 4.0), 1.0, 0.5)])
    terms = TermsFunction(build_chain(case.composed, [A1]))(np.array([7.0, 0.2]))
    assert terms.psi == pytest.approx([0.2 + 0.5 - 1.0])
    assert terms.c[0] == pytest.approx([0.0, 1.0])


@pytest.mark.parametrize(
    ("name", "count", "expected"),
    [
        ("double integrators", 1, r"safety\.alpha: .*relative degree q is"),
        ("double integrators", 3, r"safety\.alpha: .*relative degree q is"),
        ("single integrators", 2, r"expected 1 gains .* got 2"),
    ],
)
def test_a_wrong_number_of_gains_says_the_relative_degree(name, count, expected):
    with pytest.raises(RelativeDegreeError, match=expected):
        build_chain(chain_of(name)[0].composed, [1.0] * count)


@pytest.mark.parametrize("alphas", [[1.0], [1.0, 1.0]])
def test_mixed_relative_degree_names_the_agents_on_each_side(alphas):
    heavy = DoubleIntegrator(3.0, 0.7, 2)
    mixed = swarm_of([SingleIntegrator(1.0), heavy, heavy]).composed
    expected = r"relativedeg.* inputs of a appear in ψ_1, those of b, c only later"
    with pytest.raises(RelativeDegreeError, match=expected):
        build_chain(mixed, alphas)


def test_a_constant_zero_in_the_actuation_does_not_count_as_an_input_that_appears():
    """0·∂h/∂v is a stored zero to CasADi, and would feign relative degree 1."""

    class Padded(DoubleIntegrator):
        def actuation(self, x: ca.SX) -> ca.SX:
            return ca.vertcat(ca.densify(ca.SX.zeros(2, 2)), ca.SX.eye(2))

    padded = swarm_of([Padded(3.0, 0.7, 2)] * 2).composed
    assert build_chain(padded, [1.0, 1.0]).relative_degree == 2
