"""ε(Γ) of Eq. (epsT) and η(Γ) of Eq. (mainetadef)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from phalanx.theory.margins.constants import MarginConstants, epsilon

gammas = st.floats(1e-6, 0.5)
mus = st.floats(0.1, 50.0)
lipschitz = st.floats(1e-3, 30.0)


@given(gammas, gammas, mus, st.one_of(st.just(0.0), lipschitz))
def test_epsilon_is_of_class_k_in_the_sampling_time(one, other, mu, l):
    assert epsilon(0.0, mu, l) == 0.0
    shorter, longer = sorted((one, other))
    if longer > shorter * (1 + 1e-9):
        assert epsilon(shorter, mu, l) < epsilon(longer, mu, l)


@given(gammas, mus, lipschitz)
def test_epsilon_is_the_integral_of_mu_growing_at_the_lipschitz_rate(gamma, mu, l):
    integral, _ = quad(lambda t: mu * np.exp(l * t), 0.0, gamma)
    assert epsilon(gamma, mu, l) == pytest.approx(integral, rel=1e-9)


@given(gammas, mus, lipschitz)
def test_the_limit_of_no_lipschitz_constant_is_the_tightest(gamma, mu, l):
    assert epsilon(gamma, mu) == pytest.approx(mu * gamma)
    assert epsilon(gamma, mu) <= epsilon(gamma, mu, l)
    assert epsilon(gamma, mu, 1e-9) == pytest.approx(epsilon(gamma, mu), rel=1e-6)


def test_eta_is_the_papers_formula_worked_by_hand():
    """(1 + 2·3 + 4 + 5) · (10 · 0.012) + 6 · 8.65 = 16 · 0.12 + 51.9."""
    constants = MarginConstants(
        c_f=1.0, c_g=2.0, c_alpha=4.0, c_gamma=5.0, c_h=6.0, u_max=3.0, mu=10.0
    )
    assert constants.eta(0.012, 8.65) == pytest.approx(1.92 + 51.9)
