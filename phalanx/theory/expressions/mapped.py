"""CasADi expressions of a few numbers, compiled once and evaluated for many rows in one call."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.theory.expressions.portable import portable_function

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class _Memory(NamedTuple):
    """Preallocated for a number of rows."""

    buffer: Any
    """Must live as long as the trigger."""
    trigger: Any
    rows: Array
    results: Array


class MappedFunction:
    """A function of one row of numbers; a call costs about a microsecond beside the work itself.

    Nothing is compiled for a number of rows, only memory set aside, which is kept. Every row's
    results are the same bits on any CPU, and the same whatever rows are beside it.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Columns of symbols, in a row's order; expressions of them, each flattened by rows."""
        row = ca.vertcat(*inputs)
        flat = ca.vertcat(*[ca.vec(ca.densify(o.T)) for o in outputs])
        self._function = portable_function([row], flat)
        self._widths = row.numel(), flat.numel()
        self._memories: dict[int, _Memory] = {}

    def __call__(self, values: Array, index: Index) -> Array:
        """Evaluate at the rows values[..., index]; the results are the caller's to keep.

        Args:
            values: shape (v,), or (s, v) for several states at once.
            index: shape (r, inputs).

        Returns:
            shape (r, outputs), or (s, r, outputs).
        """
        shape = (*values.shape[:-1], len(index))
        count = int(np.prod(shape))
        memory = self._memory(count)
        rows = memory.rows[:count].reshape(*shape, self._widths[0])
        # Any other mode would copy once more: it must be able to leave `out` untouched.
        values.take(index, axis=-1, out=rows, mode="clip")
        memory.trigger()
        return memory.results[:count].copy().reshape(*shape, self._widths[1])

    def _memory(self, count: int) -> _Memory:
        capacity = _rounded_up(count)
        if capacity not in self._memories:
            rows, results = (np.zeros((capacity, width)) for width in self._widths)
            buffer, trigger = self._function.map(capacity).buffer()
            buffer.set_arg(0, memoryview(rows))  # type: ignore[call-arg,arg-type]
            buffer.set_res(0, memoryview(results))  # type: ignore[call-arg,arg-type]
            self._memories[capacity] = _Memory(buffer, trigger, rows, results)
        return self._memories[capacity]


def _rounded_up(count: int) -> int:
    """At most an eighth more: few sizes serve all counts."""
    step = 1 << max(0, max(1, count).bit_length() - 4)
    return -(-max(1, count) // step) * step
