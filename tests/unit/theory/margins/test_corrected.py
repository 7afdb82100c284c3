"""The corrected margin: the disturbance counts in every ψ_k, not in ψ_0 alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.integrators import DoubleIntegrator
from phalanx.theory.safety.chain import build_chain
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.function import Separation

seeds = st.integers(0, 2**32 - 1)
PHI = [0.4, 0.7]


def pair_of_doubles() -> ComposedSet:
    double = DoubleIntegrator(2.0, 0.5, 2)
    members = [Member("a", double, False), Member("b", double, True)]
    return compose(members, [], Separation(1.0), 1.0)


@pytest.fixture(scope="module")
def corrected() -> CompiledFunction:
    """The row's disturbance term and ψ_1 of a pair, corrected."""
    composed = pair_of_doubles()
    chain = build_chain(composed, [0.6, 0.9], 3.0, PHI)
    outputs = [composed.substitute(e) for e in (chain.disturbance, chain.psi[1])]
    return CompiledFunction([composed.x], outputs)


@given(seed=seeds)
def test_the_corrected_row_bounds_the_disturbance_in_psi_1(corrected, seed):
    """D_2 = Σ ‖∂ψ_1/∂x_l‖ φ_l^max; for one pair ∂ψ_1/∂x_a = (-2 V - 2 α_1 D, -2 D)."""
    x = np.random.default_rng(seed).uniform(-3, 3, 8)
    d, v = x[:2] - x[4:6], x[2:4] - x[6:]
    disturbance, psi = corrected(x)
    slope = np.linalg.norm(np.concatenate([-2 * v - 2 * 0.6 * d, -2 * d]))
    assert disturbance == pytest.approx([slope * sum(PHI)], rel=1e-6)
    psi_1 = -2 * d @ v + 3.0 + 0.6 * (1 - d @ d)
    assert psi == pytest.approx([psi_1])


def test_the_printed_row_forgets_the_disturbance_in_psi_1():
    assert build_chain(pair_of_doubles(), [0.6, 0.9], 3.0).disturbance.is_zero()
