"""Whether the truth stays in S_I: the largest of all ψ_1 ... ψ_{q-1}."""

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.safety.composition import ComposedSet
from phalanx.theory.safety.pairs import PairFunctions
from phalanx_plant.world.composition import Composed


class LargestPsi:
    """Of the pairs that count, each for itself or composed, as agents keep them.

    Neighbourhoods are left out: the composition is of all pairs.
    """

    def __init__(self, rows: SafetyRows) -> None:
        self._rows = rows
        sorts = [0 for _ in rows.swarm.members]
        self.functions = (
            rows.pair_psi
            if rows.pairwise
            else PairFunctions(rows.swarm.pairs, sorts, self._along_drift)
        )
        """What it needs of a pair: ψ_0 ... ψ_{q-1}, or h, L_f h, ..., L_f^{q-1} h."""

    def __call__(self, pairs: Array, least: Array, composed: Composed) -> Array:
        """At s states, shape (s,); empty if q = 1.

        Args:
            pairs: what the functions say of each, shape (s, r, q).
            least: no pair whose h is less counts for itself, shape (s,).
            composed: of the same pairs.
        """
        if self._rows.relative_degree == 1:
            return np.zeros(0)
        if self._rows.pairwise:
            counting = pairs[..., 0] >= least[:, None]
            each = np.where(counting, pairs[..., 1:].max(axis=2), -np.inf)
        else:
            some = np.flatnonzero(composed.weights.any(axis=0))
            jets = self._rows.composed.jets
            each = jets.psi(composed.h_tot, composed.weights[:, some], pairs[:, some])[:, 1:]
        largest: Array = each.max(axis=1)
        return largest

    def _along_drift(self, _: ComposedSet, pair: tuple[int, int]) -> MappedFunction:
        pairs = self._rows.swarm.pairs
        (kind,) = pairs.kinds_of(np.array([pair])).tolist()
        found: MappedFunction = pairs.kinds[kind].along_drift
        return found
