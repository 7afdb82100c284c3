"""ε(Γ) of Eq. (epsT) and η(Γ) of Eq. (mainetadef)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from phalanx.theory.margins.margin import MarginConstants

gammas = st.floats(1e-6, 0.5)
mus = st.floats(0.1, 50.0)
lipschitz = st.floats(1e-3, 30.0)


def eta(gamma: float, mu: float) -> float:
    """η(Γ) of a row whose rate changes by 1 for each metre, without disturbance: ε(Γ)."""
    return MarginConstants(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, mu).eta(gamma, 0.0)


@given(gammas, gammas, mus)
def test_eta_is_of_class_k_in_the_sampling_time(one, other, mu):
    assert eta(0.0, mu) == 0.0
    shorter, longer = sorted((one, other))
    if longer > shorter * (1 + 1e-9):
        assert eta(shorter, mu) < eta(longer, mu)


@given(gammas, mus, lipschitz)
def test_of_all_epsilon_it_takes_the_tightest(gamma, mu, l):
    """The paper's bounds are integrals of μ growing at a rate L', any above 0."""
    integral, _ = quad(lambda t: mu * np.exp(l * t), 0.0, gamma)
    assert eta(gamma, mu) <= integral
    least, _ = quad(lambda t: mu * np.exp(1e-9 * t), 0.0, gamma)
    assert eta(gamma, mu) == pytest.approx(least, rel=1e-6)


def test_eta_is_the_papers_formula_worked_by_hand():
    """(1 + 2·3 + 4 + 5) · (10 · 0.012) + 6 · 8.65 = 16 · 0.12 + 51.9."""
    constants = MarginConstants(
        c_f=1.0, c_g=2.0, c_alpha=4.0, c_gamma=5.0, c_h=6.0, u_max=3.0, mu=10.0
    )
    assert constants.eta(0.012, 8.65) == pytest.approx(1.92 + 51.9)
