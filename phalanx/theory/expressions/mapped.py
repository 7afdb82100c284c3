"""CasADi expressions of a few numbers, compiled once and evaluated for many rows in one call."""

from collections.abc import Sequence
from functools import cached_property

import casadi as ca
import numpy as np

from phalanx.arrays import Array, Index
from phalanx.theory.expressions.bound import BoundFunction, rounded_up
from phalanx.theory.expressions.portable import portable_function

_MOST_ROWS = 2**17
"""Evaluated in one call, of several states: memory for them is kept."""


class MappedFunction:
    """A function of one row of numbers; a call costs two microseconds beside the work itself.

    Nothing is compiled for a number of rows: memory is set aside for it, and kept. A row's results
    are the same bits on any CPU, whatever rows are beside it.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Columns of symbols, in a row's order; expressions of them, flattened row by row."""
        flat = ca.vertcat(*[ca.vec(ca.densify(o.T)) for o in outputs])
        self._function = portable_function([ca.vertcat(*inputs)], flat)
        self.inputs, self.results = self._function.numel_in(0), self._function.numel_out(0)
        """Numbers of an input row, and of a result row."""
        self._bound: dict[int, BoundFunction] = {}

    def __call__(self, values: Array, places: Index) -> Array:
        """Evaluate at the rows values[..., places]; the results are the caller's to keep.

        Args:
            values: shape (v,), or (s, v) for several states at once.
            places: shape (r, inputs).

        Returns:
            shape (r, outputs), or (s, r, outputs).
        """
        at_once = max(_MOST_ROWS // max(len(places), 1), 1)
        if values.ndim > 1 and len(values) > at_once:
            blocks = [values[k : k + at_once] for k in range(0, len(values), at_once)]
            return np.concatenate([self(block, places) for block in blocks])
        shape = (*values.shape[:-1], len(places))
        count = len(places) if values.ndim == 1 else len(places) * len(values)
        bound = self._for(count)
        rows = bound.inputs[0][: count * self.inputs].reshape(*shape, self.inputs)
        # In any other mode it would be written to a copy first.
        values.take(places, axis=-1, out=rows, mode="clip")
        bound.call()
        return bound.outputs[0][: count * self.results].reshape(*shape, self.results).copy()

    def at(self, places: Index) -> "MappedRows":
        """The same rows of one state after another, shape (r, inputs)."""
        bound, count = self._for(len(places)), len(places)
        rows = bound.inputs[0][: count * self.inputs].reshape(count, self.inputs)
        results = bound.outputs[0][: count * self.results].reshape(count, self.results)
        return MappedRows(places, bound, rows, results)

    @cached_property
    def text(self) -> str:
        """The same for equal functions only."""
        found: str = self._function.serialize()
        return found

    def mapped(self, count: int) -> ca.Function:
        """Of so many rows, one for each column."""
        return self._function.map(count)

    def _for(self, count: int) -> BoundFunction:
        capacity = rounded_up(count)
        if capacity not in self._bound:
            self._bound[capacity] = BoundFunction(self.mapped(capacity))
        return self._bound[capacity]


class MappedRows:
    """Rows that are evaluated again and again, without copies."""

    def __init__(self, places: Index, bound: BoundFunction, rows: Array, results: Array) -> None:
        self._places, self._bound, self._rows = places, bound, rows
        self.results = results
        """Of the last call, shape (r, outputs), until rows of the same function are evaluated."""

    def __call__(self, values: Array) -> None:
        """Evaluate at values[places], of shape (v,)."""
        values.take(self._places, out=self._rows, mode="clip")
        self._bound.call()
