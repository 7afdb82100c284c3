"""h_tot's ψ-chain from its pairs' numbers, at one state with its slopes, or at several."""

import numpy as np
import pytest

from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.jets import LogSumExpJets


@pytest.mark.parametrize("q", [1, 2, 3])
def test_psi_at_several_states_is_what_each_has_alone_and_pairs_without_weight_change_no_digit(q):
    rho = 0.05
    jets = LogSumExpJets(rho, [Linear(0.4)] * q, 39.0)
    rng = np.random.default_rng(q)
    for states, pairs in ((1, 1), (5, 3), (16, 62), (2, 62), (3, 17)):
        h = rng.normal(size=(states, pairs, q + 1)) * [100.0, *[10.0] * q]
        weights = np.exp(rho * (h[..., 0] - h[..., 0].max(axis=1, keepdims=True)))
        h_tot = h[..., 0].max(axis=1) + np.log(weights.sum(axis=1)) / rho
        w = weights / weights.sum(axis=1, keepdims=True)
        psi = jets.psi(h_tot, w, h[..., :q])
        alone = np.stack([jets(one).psi for one in h])
        assert psi == pytest.approx(alone, rel=1e-11, abs=1e-11)
        w[:, pairs // 2] = 0.0
        without = np.delete(w, pairs // 2, axis=1), np.delete(h[..., :q], pairs // 2, axis=1)
        if pairs > 1:
            assert (jets.psi(h_tot, w, h[..., :q]) == jets.psi(h_tot, *without)).all()


@pytest.mark.parametrize("q", [1, 2, 3])
def test_weights_are_the_slopes_of_the_last_psi_by_each_pairs_derivatives(q):
    """Compare with central differences; from q = 3 on the product rule counts terms twice."""
    rng = np.random.default_rng(q)
    jets = LogSumExpJets(0.7, [Linear(0.4 + 0.2 * k) for k in range(q)], 0.5)
    h, step = rng.normal(size=(4, q + 1)), 1e-5
    weights = jets(h).weights.copy()
    for p in range(4):
        for j in range(q):
            moved = np.zeros_like(h)
            moved[p, j] = step
            slope = (jets(h + moved).psi[-1] - jets(h - moved).psi[-1]) / (2.0 * step)
            assert weights[p, j] == pytest.approx(slope, rel=1e-6, abs=1e-8)
