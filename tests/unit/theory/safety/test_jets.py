"""h_tot's ψ-chain from its pairs' numbers, at one state and at several in one call."""

import numpy as np
import pytest

from phalanx.theory.safety.class_k import Linear
from phalanx.theory.safety.jets import LogSumExpJets


@pytest.mark.parametrize("q", [1, 2, 3])
def test_several_states_have_the_bits_that_each_has_alone(q):
    jets = LogSumExpJets(0.05, [Linear(0.4)] * q, 39.0)
    rng = np.random.default_rng(q)
    for states, pairs in ((1, 1), (5, 3), (16, 62), (2, 62), (3, 17)):
        h = rng.normal(size=(states, pairs, q + 1)) * [100.0, *[10.0] * q]
        each = np.stack([jets(one).psi for one in h])
        assert jets.psi(h).tobytes() == each.tobytes()
        assert each.shape == (states, q)
