"""CasADi expressions, compiled once and called through preallocated memory.

CompiledFunction takes vectors; MappedFunction evaluates one expression for many rows in one call.
"""

import ctypes
from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial

import casadi as ca
import numpy as np

from phalanx.native.library import Native, address, native
from phalanx.theory.arrays import Array, Index
from phalanx.theory.expressions.portable import portable_function


class BoundFunction:
    """A CasADi function called in place: write `inputs`, call, read `outputs`; column by column."""

    def __init__(self, function: ca.Function, inputs: Sequence[Array] | None = None) -> None:
        """inputs: arrays to read, which no other function may use; None for new ones."""
        self.inputs = inputs or [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self.outputs = [np.zeros(function.numel_out(k)) for k in range(function.n_out())]
        # The trigger alone does not keep the buffer alive.
        self._buffer, self.call = function.buffer()
        for k, array in enumerate(self.inputs):
            self._buffer.set_arg(k, memoryview(array))  # type: ignore[call-arg,arg-type]
        for k, array in enumerate(self.outputs):
            self._buffer.set_res(k, memoryview(array))  # type: ignore[call-arg,arg-type]


class _BoundRows:
    """A function of a column, called in place for `count` rows; as machine code if it is built."""

    def __init__(self, function: ca.Function, count: int, compiled: Native | None) -> None:
        """function: of one column, with one column as result. compiled: the same, if built."""
        self.call: Callable[[], object]
        if compiled:
            self.arguments = np.zeros(count * function.numel_in(0))
            self.results = np.zeros(count * function.numel_out(0))
            addresses = address(self.arguments), address(self.results)
            self.call = partial(compiled.rows, *addresses, ctypes.c_longlong(count))
        else:
            self._bound = BoundFunction(function.map(count) if count > 1 else function)
            (self.arguments,), (self.results,) = self._bound.inputs, self._bound.outputs
            self.call = self._bound.call


_View = tuple[Array, Callable[[], object], Array]
"""Rows of inputs to write, the call, and rows of results to read, shapes (r, ...)."""


@cache
def rounded_up(count: int) -> int:
    """Round a count up by at most an eighth, so that few sizes are compiled or allocated."""
    step = 1 << max(0, max(1, count).bit_length() - 4)
    return -(-max(1, count) // step) * step


class CompiledFunction:
    """A function of vectors that returns arrays; a call costs about a microsecond.

    The same inputs give the same bits on any CPU.

    >>> x = ca.SX.sym("x", 2)
    >>> CompiledFunction([x], [ca.sumsqr(x)])(np.array([3.0, 4.0]))
    [array([25.])]
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Compile; inputs are columns, shape (n,) each.

        A column or row output is returned with shape (n,), others with shape (rows, columns).
        """
        flat = ca.vertcat(*[ca.vec(ca.densify(o.T)) for o in outputs])
        function = portable_function([ca.vertcat(*inputs)], flat)
        self.compiled = native(function)
        """Machine code of it; None if it is not built."""
        self._bound = _BoundRows(function, 1, self.compiled)
        last = np.cumsum([i.numel() for i in inputs]).tolist()
        self._inputs = [
            self._bound.arguments[end - i.numel() : end]
            for i, end in zip(inputs, last, strict=True)
        ]
        ends = np.cumsum([o.numel() for o in outputs])
        self._outputs = [
            self._bound.results[end - o.numel() : end].reshape(-1 if 1 in o.shape else o.shape)
            for o, end in zip(outputs, ends.tolist(), strict=True)
        ]

    def __call__(self, *values: Array | float) -> list[Array]:
        """Evaluate at one value for each input; the results are new arrays."""
        for array, value in zip(self._inputs, values, strict=True):
            array[:] = value
        self._bound.call()
        return [output.copy() for output in self._outputs]


_MOST_ROWS = 2**17
"""Rows that one call evaluates at most; memory for that many is kept."""


class MappedFunction:
    """A function of one row of numbers, evaluated for many rows; a call adds two microseconds.

    Any number of rows needs memory only, which is kept, and no compilation. A row's results are the
    same bits on any CPU, and do not depend on the other rows.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Compile; inputs are columns of symbols, outputs are flattened row by row."""
        flat = ca.vertcat(*[ca.vec(ca.densify(o.T)) for o in outputs])
        self._function = portable_function([ca.vertcat(*inputs)], flat)
        self.inputs, self.results = self._function.numel_in(0), self._function.numel_out(0)
        """Lengths of an input row and of a result row."""
        self._bound: dict[int, _BoundRows] = {}
        self._views: dict[int, _View] = {}
        """By number of rows."""

    def __call__(self, values: Array, indices: Index) -> Array:
        """Evaluate at the rows values[..., indices]; the results are a new array.

        Args:
            values: shape (v,), or (s, v) for several states at once.
            indices: shape (r, inputs).

        Returns:
            shape (r, outputs), or (s, r, outputs).
        """
        count = len(indices)
        if values.ndim == 1:
            arguments, call, results = self._views.get(count) or self._view(count)
            # In any other mode `take` would write to a copy first.
            values.take(indices, out=arguments, mode="clip")
            call()
            return results.copy()
        states = len(values)
        rows = states * count
        if rows > _MOST_ROWS and states > 1:
            at_once = max(_MOST_ROWS // count, 1)
            blocks = [values[k : k + at_once] for k in range(0, states, at_once)]
            return np.concatenate([self(block, indices) for block in blocks])
        arguments, call, results = self._views.get(rows) or self._view(rows)
        values.take(
            indices, axis=-1, out=arguments.reshape(*values.shape[:-1], *indices.shape), mode="clip"
        )
        call()
        return results.copy().reshape(*values.shape[:-1], count, self.results)

    def rows(self, rows: Array) -> Array:
        """Evaluate at rows of inputs, shape (r, inputs); the results are a new array."""
        arguments, call, results = self._views.get(len(rows)) or self._view(len(rows))
        arguments[:] = rows
        call()
        return results.copy()

    def at(self, indices: Index) -> "MappedRows":
        """Fix the indices, shape (r, inputs), for many calls without copies."""
        return MappedRows(indices, self._view(len(indices)))

    def mapped(self, count: int) -> ca.Function:
        """The CasADi function of `count` rows, one for each column; it may have no derivatives."""
        compiled = self.compiled
        return (compiled.function if compiled else self._function).map(count)

    @cached_property
    def compiled(self) -> Native | None:
        """Machine code of it; None if it is not built."""
        # To look for it takes a millisecond: the key is the function's text.
        return native(self._function)

    def _view(self, count: int) -> _View:
        capacity = rounded_up(count)
        if capacity not in self._bound:
            self._bound[capacity] = _BoundRows(self._function, capacity, self.compiled)
        bound = self._bound[capacity]
        view = self._views[count] = (
            bound.arguments[: count * self.inputs].reshape(count, self.inputs),
            bound.call,
            bound.results[: count * self.results].reshape(count, self.results),
        )
        return view


class MappedRows:
    """Rows of a MappedFunction that are evaluated again and again, without copies."""

    def __init__(self, indices: Index, view: _View) -> None:
        self._indices, (self._arguments, self._call, self.results) = indices, view
        """Results of the last call, shape (r, outputs); the next call overwrites them."""

    def __call__(self, values: Array) -> None:
        """Evaluate at values[indices]; values has shape (v,)."""
        values.take(self._indices, out=self._arguments, mode="clip")
        self._call()
