"""CasADi expressions, compiled once and called through preallocated memory."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.theory.expressions.portable import portable_function


class CompiledFunction:
    """A function of vectors that returns arrays; a call costs about a microsecond.

    All outputs lie in one block, so that a call copies once. The same inputs give the same bits
    on any CPU.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        """Column inputs, shape (n,) each; outputs of any shape.

        A column or row output is returned with shape (n,), others with shape (rows, columns).
        """
        flat = ca.vertcat(*[ca.vec(ca.densify(o.T)) for o in outputs])
        self._function = portable_function(inputs, flat)
        self._buffer, self._trigger = self._function.buffer()
        self._inputs = [np.zeros(i.numel()) for i in inputs]
        self._block = np.zeros(flat.numel())
        for k, array in enumerate(self._inputs):
            self._buffer.set_arg(k, memoryview(array))  # type: ignore[call-arg,arg-type]
        self._buffer.set_res(0, memoryview(self._block))  # type: ignore[call-arg,arg-type]
        ends = np.cumsum([o.numel() for o in outputs])
        self._layout = [
            (int(end) - o.numel(), int(end), None if 1 in o.shape else o.shape)
            for o, end in zip(outputs, ends, strict=True)
        ]

    def __call__(self, *values: Array | float) -> list[Array]:
        """Evaluate at one value for each input; the results are the caller's to keep."""
        for array, value in zip(self._inputs, values, strict=True):
            array[:] = value
        self._trigger()
        block = self._block.copy()
        return [
            block[begin:end] if shape is None else block[begin:end].reshape(shape)
            for begin, end, shape in self._layout
        ]
