"""η(Γ) of Eq. (mainetadef)."""

import pytest

from phalanx.theory.margins.margin import MarginConstants


def test_eta_is_the_papers_formula_worked_by_hand():
    """(1 + 2·3 + 4 + 5) · (10 · 0.012) + 6 · 8.65 = 16 · 0.12 + 51.9."""
    constants = MarginConstants(
        c_f=1.0, c_g=2.0, c_alpha=4.0, c_gamma=5.0, c_h=6.0, u_max=3.0, mu=10.0
    )
    assert constants.eta(0.012, 8.65) == pytest.approx(1.92 + 51.9)
