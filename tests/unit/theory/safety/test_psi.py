"""The ψ-chain and its Lie derivatives, against finite differences and hand formulas."""

from collections.abc import Callable
from functools import cache

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.integrators import SingleIntegrator
from phalanx.theory.models.wheeled import Unicycle
from phalanx.theory.safety.chain import Chain, RelativeDegreeError, build_chain
from phalanx.theory.safety.function import Separation
from tests.unit.theory.users_own import (
    Case,
    Draggy,
    Drifter,
    Jerky,
    OutputUnicycle,
    Oval,
    along,
    swarm_of,
)
from tests.unit.theory.whole_expression import TermsFunction

ALPHA = 1.7
SWARMS: dict[str, Callable[[], Case]] = {
    "unicycles": lambda: swarm_of([Unicycle(4.0, 2.0)] * 3),
    "single integrators": lambda: swarm_of([SingleIntegrator(1.0)] * 4, adversaries=2, rho=5.0),
    "a user's dynamics": lambda: swarm_of([Drifter()] * 3, function=Oval()),
    "a mixture": lambda: swarm_of(
        [Unicycle(1.0, 1.0, 0.4), Drifter(), SingleIntegrator(1.0), OutputUnicycle()],
        function=Oval(2.0, 1.0),
    ),
}
seeds = st.integers(0, 2**32 - 1)


@cache
def built(name: str) -> tuple[Case, TermsFunction]:
    """One of the swarms, and the terms of its chain."""
    case = SWARMS[name]()
    return case, TermsFunction(build_chain(case.composed, [ALPHA]))


def state(n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-2.5, 2.5, n)


@pytest.mark.slow
@pytest.mark.parametrize("name", SWARMS)
@given(seed=seeds)
@settings(max_examples=10)
def test_lie_derivatives_of_h_tot_are_its_slopes_along_f_and_the_columns_of_g(name, seed):
    case, function = built(name)
    twin, x = case.twin, state(case.composed.x.numel(), seed)
    terms = function(x)
    drifts = [along(twin.h_tot, x, twin.f(l, x)) for l in range(len(twin.members))]
    assert terms.psi == pytest.approx([twin.h_tot(x)])
    assert terms.unforced == pytest.approx(sum(drifts) + ALPHA * twin.h_tot(x), rel=1e-5, abs=1e-6)
    for l, c in terms.c.items():
        slopes = [along(twin.h_tot, x, column) for column in twin.g(l, x).T]
        assert c == pytest.approx(slopes, rel=1e-5, abs=1e-6)
        assert terms.positions[l] == pytest.approx(twin.position(l, x))


def test_the_unforced_part_of_a_driftless_swarm_is_alpha_of_h_alone():
    terms = built("unicycles")[1](np.arange(9.0))
    assert terms.unforced == pytest.approx(ALPHA * terms.psi[0])


A1, A2, XI = 1.2, 0.9, 4.0


@pytest.fixture(scope="module")
def pair() -> Chain:
    """The chain of two double integrators with drag."""
    return build_chain(swarm_of([Draggy(), Draggy()], obstacles=()).composed, [A1, A2], XI)


@pytest.fixture(scope="module")
def pair_terms(pair: Chain) -> TermsFunction:
    return TermsFunction(pair)


@given(seed=seeds)
def test_psi_1_and_its_lie_derivatives_of_two_double_integrators_are_the_hand_formulas(
    pair, pair_terms, seed
):
    """One pair, so h_tot = h = R² - |D|² and ψ_1 = -2 D·V + ξ + α_1 h.

    With drag β, V' = -β V + u_a - u_b: ψ_1' = -2|V|² - 2 D·(V' ) - 2 α_1 D·V.
    """
    x = state(8, seed)
    terms = pair_terms(x)
    D, V = x[:2] - x[4:6], x[2:4] - x[6:8]
    psi_0 = 1.0 - D @ D
    psi_1 = -2 * D @ V + XI + A1 * psi_0
    unforced = -2 * V @ V + 2 * Draggy().drag * D @ V - 2 * A1 * D @ V + A2 * psi_1
    assert pair.relative_degree == 2
    assert terms.psi == pytest.approx([psi_0, psi_1])
    assert terms.unforced == pytest.approx(unforced)
    assert terms.c[0] == pytest.approx(-2 * D)
    assert terms.c[1] == pytest.approx(2 * D)


@pytest.fixture(scope="module")
def three() -> tuple[Case, TermsFunction, CompiledFunction]:
    """Three double integrators: the case, its terms, and ψ_1 alone."""
    case = swarm_of([Draggy(), Draggy(0.2), Draggy()], function=Oval(), rho=1.5)
    chain = build_chain(case.composed, [A1, A2], XI)
    psi_1 = CompiledFunction([case.composed.x], [case.composed.substitute(chain.psi[1])])
    return case, TermsFunction(chain), psi_1


@given(seed=seeds)
@settings(max_examples=25)
def test_the_chain_of_relative_degree_2_follows_finite_differences(three, seed):
    case, function, settled = three
    x, twin = state(12, seed), case.twin
    terms = function(x)

    def drift(y: np.ndarray) -> np.ndarray:
        return sum(twin.f(l, y) for l in range(3))

    def psi_1(y: np.ndarray) -> float:
        return along(twin.h_tot, y, drift(y)) + XI + A1 * twin.h_tot(y)

    def exact(y: np.ndarray) -> float:
        return settled(y)[0][0]

    assert terms.psi == pytest.approx([twin.h_tot(x), psi_1(x)], rel=1e-5, abs=1e-5)
    unforced = along(exact, x, drift(x)) + A2 * psi_1(x)
    assert terms.unforced == pytest.approx(unforced, rel=1e-4, abs=1e-4)
    for l, c in terms.c.items():
        slopes = [along(exact, x, column) for column in twin.g(l, x).T]
        assert c == pytest.approx(slopes, rel=1e-4, abs=1e-5)


@pytest.fixture(scope="module")
def jerky() -> TermsFunction:
    case = swarm_of([Jerky(), Jerky()], obstacles=())
    return TermsFunction(build_chain(case.composed, [1.0, 2.0, 3.0], XI))


@given(seed=seeds)
@settings(max_examples=25)
def test_the_chain_goes_to_relative_degree_3(jerky, seed):
    """One pair on a line at distance D = x_a - x_b, and E = y_a - y_b, which is constant."""
    x = state(8, seed)
    D, E, V, A = x[:4] - x[4:]
    h, h1, h2 = 1 - D * D - E * E, -2 * D * V, -2 * V * V - 2 * D * A
    h3_unforced = -6 * V * A
    psi_1 = h1 + XI + 1.0 * h
    psi_2 = h2 + h1 + 2.0 * psi_1
    unforced = h3_unforced + h2 + 2.0 * (h2 + h1) + 3.0 * psi_2
    terms = jerky(x)
    assert terms.psi == pytest.approx([h, psi_1, psi_2])
    assert terms.unforced == pytest.approx(unforced)
    assert terms.c[0] == pytest.approx([-2 * D])
    assert terms.c[1] == pytest.approx([2 * D])


def test_xi_is_not_used_when_the_relative_degree_is_one():
    case, without = built("unicycles")
    with_xi, x = TermsFunction(build_chain(case.composed, [ALPHA], 99.0)), np.arange(9.0)
    assert with_xi(x).unforced == without(x).unforced


@pytest.mark.parametrize("alphas", [[1.0], [1.0, 1.0, 1.0]])
def test_a_wrong_number_of_gains_says_the_relative_degree(pair, alphas):
    with pytest.raises(RelativeDegreeError, match=r"safety\.alpha: .*relative degree q is"):
        build_chain(pair.set, alphas)


def test_too_many_gains_says_how_many_were_expected_and_given():
    with pytest.raises(RelativeDegreeError, match=r"expected 1 gains .* got 2"):
        build_chain(built("unicycles")[0].composed, [1.0, 1.0])


@pytest.mark.parametrize("alphas", [[1.0], [1.0, 1.0]])
def test_mixed_relative_degree_names_the_agents_on_each_side(alphas):
    mixed = swarm_of([SingleIntegrator(1.0), Draggy(), Draggy()]).composed
    with pytest.raises(RelativeDegreeError, match=r"inputs of a appear in ψ_1.* of b, c only") as e:
        build_chain(mixed, alphas)
    assert "relativedeg" in str(e.value)


def test_a_constant_zero_in_the_actuation_does_not_count_as_an_input_that_appears():
    """0·∂h/∂v is a stored zero to CasADi, and would feign relative degree 1."""

    class Padded(Draggy):
        def actuation(self, x: ca.SX) -> ca.SX:
            return ca.vertcat(ca.densify(ca.SX.zeros(2, 2)), ca.SX.eye(2))

    padded = swarm_of([Padded(), Padded()], function=Separation(1.0)).composed
    assert build_chain(padded, [1.0, 1.0]).relative_degree == 2
