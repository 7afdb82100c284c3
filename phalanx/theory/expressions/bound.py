"""A CasADi function bound to arrays of its own, which a call reads and writes without copies."""

from collections.abc import Sequence
from functools import cache

import casadi as ca
import numpy as np

from phalanx.arrays import Array


class BoundFunction:
    """Write `inputs`, call, read `outputs`: flat, in CasADi's order, column by column."""

    def __init__(self, function: ca.Function, inputs: Sequence[Array] | None = None) -> None:
        """inputs: arrays to read, which are the function's from now on; None for new ones."""
        self.inputs = inputs or [np.zeros(function.numel_in(k)) for k in range(function.n_in())]
        self.outputs = [np.zeros(function.numel_out(k)) for k in range(function.n_out())]
        # The trigger alone does not keep the buffer alive.
        self._buffer, self.call = function.buffer()
        for k, array in enumerate(self.inputs):
            self._buffer.set_arg(k, memoryview(array))  # type: ignore[call-arg,arg-type]
        for k, array in enumerate(self.outputs):
            self._buffer.set_res(k, memoryview(array))  # type: ignore[call-arg,arg-type]


@cache
def rounded_up(count: int) -> int:
    """A count of rows to set memory aside for: at most an eighth more, so that few serve all."""
    step = 1 << max(0, max(1, count).bit_length() - 4)
    return -(-max(1, count) // step) * step
