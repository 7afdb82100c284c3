"""The rows of pairs as tables: of each agent its pairs, and the functions of their rows."""

from typing import Any

import numpy as np

from phalanx.native.loop.kernels import Kernels, begins
from phalanx.native.loop.memory import MOST_INPUTS
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.rows.least_violation import CompiledVertex, compiled_vertex
from phalanx.theory.rows.nearest_point import LIMITS, CompiledPoint, compiled_point
from phalanx.theory.rows.pairs import PairRowFunction
from phalanx.theory.safety.pairs import spread

_BINDINGS = 8192


class _Functions:
    """Functions of rows, numbered; equal ones are one object."""

    def __init__(self) -> None:
        self.every: list[PairRowFunction] = []

    def number(self, function: PairRowFunction) -> int:
        """Return the number of a function."""
        if function not in self.every:
            self.every.append(function)
        return self.every.index(function)


def pair_tables(rows: SafetyRows, kernels: Kernels) -> dict[str, Any]:
    """Return the tables of rows of pairs: those that run.h declares from pairwise to row_numbers.

    Empty ones if all pairs are composed.
    """
    swarm, functions = rows.swarm, _Functions()
    count, pairwise = len(swarm.members), swarm.safety.pairwise
    others, half, whole, indices = list[int](), list[int](), list[int](), list[Array]()
    counts = [0] * count
    for i in swarm.normal if pairwise else ():
        own_pairs = swarm.pairs.of(i, range(count))
        counts[i], margin = len(own_pairs), rows.margin(i)
        for pair in own_pairs:
            (other,) = pair[pair != i].tolist()
            parts = [rows.row_function(i, margin, other, RowPart.WHOLE)]
            if other in swarm.sharing:
                parts.append(rows.row_function(i, margin, other, RowPart.HALF))
            others.append(other)
            whole.append(functions.number(parts[0]))
            half.append(functions.number(parts[1]) if parts[1:] else -1)
            indices.append(spread(swarm.pairs.begin, pair[None], parts[0].sizes)[0])
    m = max(len(member.dynamics.inputs) for member in swarm.members)
    most = max(counts)
    program = (most + 2 * MOST_INPUTS) * (m + 2) + 2 * m + most + 2 * MOST_INPUTS
    return {
        "pairwise": pairwise, "row_at": begins(counts), "row_other": others, "row_half": half,
        "row_whole": whole, "row_index_at": begins(map(len, indices))[:-1],
        "row_index": np.concatenate([np.zeros(0, int), *indices]),
        "shares": [i in swarm.sharing for i in range(count)], "row_kind": np.zeros(len(others)),
        "row_function": [kernels(function.evaluate) for function in functions.every],
        "kind_width": [function.evaluate.inputs for function in functions.every],
        "kind_half": [function.part is RowPart.HALF for function in functions.every],
        "row_a": np.zeros(most * m), "row_bound": np.zeros(most), "row_margin": np.zeros(most),
        "residual": np.zeros(most), "program": np.zeros(2 * program), "row_of": np.zeros(most),
        "nearest_point": _place(kernels, compiled_point()) if pairwise else 0,
        "least_vertex": _place(kernels, compiled_vertex()) if pairwise else 0,
        "limits": LIMITS, "row_numbers": np.zeros(m + 2 * (most + 2 * MOST_INPUTS)),
        "bindings": 0, "binding_of": np.zeros(_BINDINGS), "most_bindings": _BINDINGS,
    }  # fmt: skip


def _place(kernels: Kernels, compiled: CompiledPoint | CompiledVertex | None) -> int:
    return kernels.place(compiled and compiled.function)
