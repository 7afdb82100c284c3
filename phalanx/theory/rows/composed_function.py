"""h_tot of the pairs in sight at one state after another: one call of a compiled function."""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import BoundFunction
from phalanx.theory.models.polytope import Polytope, extremes, polytope
from phalanx.theory.rows.by_jets import TermsByJets
from phalanx.theory.safety.pairs import ChosenPairs


class ComposedNumbers(Struct, frozen=True):
    """Terms of composed pairs, as numbers; fields are those of Terms."""

    psi: Array
    unforced: float
    c: dict[int, Array]
    least: dict[int, float]
    most: dict[int, float]
    polytopes: dict[int, Polytope]


class ComposedFunction:
    """Terms of fixed pairs and members, whose numbers it reads by tables of indices."""

    def __init__(
        self, by_jets: TermsByJets, numbers: Array, in_sight: Sequence[int], pairs: ChosenPairs
    ) -> None:
        """Choose the function.

        Args:
            by_jets: the functions.
            numbers: any state, the obstacles' parameters and the corners of each U.
            in_sight: members.
            pairs: among them, and with obstacles and limits.
        """
        members, self._degree = by_jets.members, by_jets.jets.degree
        kinds = list(members.by_kind(in_sight).items())
        sizes = [(members.kinds[k].inputs, group) for k, group in kinds]
        self._c, end = by_jets.layout(sizes, self._degree + 1)
        sizes = [(members.kinds[k].extremes.results, group) for k, group in kinds]
        self._ends, _ = by_jets.layout(sizes, end)
        self._constant = members.constant_polytopes
        self._varying = [l for l in self._ends if l not in self._constant]
        self._least = [(l, group.start) for l, group in self._ends.items() if l in self._constant]
        """(member, index of its least result) where U is constant; the most comes next."""
        function, tables = by_jets.function(kinds, pairs)
        # CasADi gathers by indices in float64, which it rounds.
        arguments = [table.ravel().astype(np.float64) for table in tables]
        self._bound = BoundFunction(function, [numbers.copy(), *arguments])
        self._x, self._results = (
            self._bound.inputs[0][: members.states[-1].stop],
            self._bound.outputs[0],
        )

    def __call__(self, x: Array) -> ComposedNumbers:
        """Evaluate at the stacked state, shape (n̄,)."""
        self._x[:] = x
        self._bound.call()
        results, q = self._results.copy(), self._degree
        numbers = results.tolist()
        composed = ComposedNumbers(
            results[:q],
            numbers[q],
            {l: results[part] for l, part in self._c.items()},
            {l: numbers[k] for l, k in self._least},
            {l: numbers[k + 1] for l, k in self._least},
            self._constant,
        )
        return self._solved(composed, results) if self._varying else composed

    def psi(self, x: Array) -> Array:
        """ψ_0 ... ψ_{q-1} alone, shape (q,), without any linear program."""
        self._x[:] = x
        self._bound.call()
        return self._results[: self._degree].copy()

    def _solved(self, composed: ComposedNumbers, results: Array) -> ComposedNumbers:
        """Add the linear programs of members whose U_l depends on the state."""
        polytopes = dict(composed.polytopes)
        for l in self._varying:
            row, c = results[self._ends[l]], composed.c[l]
            A, b = np.split(row, [len(row) * len(c) // (len(c) + 1)])
            polytopes[l] = polytope(A.reshape(len(b), -1), b)
            composed.least[l], composed.most[l] = extremes(c, polytopes[l].corners)
        return replace(composed, polytopes=polytopes)
