"""Whether the truth stays in S_I: the largest of all ψ_1 ... ψ_{q-1}."""

import numpy as np
from numpy.typing import NDArray

from phalanx.swarm.rows import SafetyRows
from phalanx.theory.safety.pair_functions import ChosenFunctions
from phalanx.theory.safety.pairs import ChosenPairs

Array = NDArray[np.float64]


class LargestPsi:
    """Of the pairs that count, each for itself or composed, as agents keep them.

    Neighbourhoods are left out: the composition is of all pairs.
    """

    def __init__(self, rows: SafetyRows) -> None:
        self._rows = rows
        self._of: ChosenPairs | None = None
        self._each: ChosenFunctions | None = None

    def __call__(self, x: Array, pairs: ChosenPairs) -> Array:
        """At stacked states x, shape (s, n̄); shape (s,), or empty if q = 1."""
        rows = self._rows
        if rows.relative_degree == 1:
            return np.zeros(0)
        if not rows.pairwise:
            composed: Array = rows.composed.jets.psi(pairs.jets(x).h)[:, 1:].max(axis=1)
            return composed
        if self._each is None or self._of is not pairs:
            self._of, self._each = pairs, rows.pair_psi.choose(pairs.pairs)
        largest: Array = self._each(x)[..., 1:].max(axis=(1, 2))
        return largest
