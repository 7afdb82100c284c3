"""Programs in a box under one row, and of the least worst violation: C, Python and rationals."""

import ctypes
from collections import Counter
from pathlib import Path

import numpy as np

from evidence.minimiser.compilers import library, packed_box, packed_vertex
from phalanx.theory.arrays import Array
from phalanx.theory.models.polytope import Box
from phalanx.theory.rows import least_violation as violation
from phalanx.theory.rows import nearest_in_box as box
from phalanx.theory.rows.row import Row
from tests.unit.theory.rows import test_least_violation as violations
from tests.unit.theory.rows import test_nearest_in_box as boxes

IN_BOX, VIOLATION = "the point in a box", "the least worst violation"


class SmallTrial:
    """Counts of what was tried, and the farthest from rational numbers."""

    def __init__(self, rng: np.random.Generator, folder: Path) -> None:
        self.counts: Counter[str] = Counter()
        self.farthest = {f"rational numbers, {what}": 0.0 for what in (IN_BOX, VIOLATION)}
        loaded = ctypes.PyDLL(str(library(folder)))
        self._rng, self._box = rng, box._checked(loaded)
        self._vertex = violation.LeastVertex()
        self._vertex._compiled = violation.CompiledVertex(loaded)

    def in_box(self, number: int) -> bytes:
        """Draw a program in a box, try and pack it."""
        kind, rng = boxes.KINDS[number % len(boxes.KINDS)], self._rng
        program = boxes.draw_box_program(kind, int(rng.integers(1, 9)), rng)
        u_nom, weights, low, high, a, bound = program
        solver = box.NearestInBox(weights)
        reference = box.nearest_in_box(*program, box.TOLERANCE)
        solver._compiled = self._box
        u = solver.solve(
            np.array(u_nom), Box(np.array(low), np.array(high)), Row(np.array(a), bound)
        )
        near = max(map(abs, u_nom)) <= box.FARTHEST
        self.counts[f"{IN_BOX}"] += 1
        self.counts[f"{IN_BOX}, with other bits in Python"] += near and not boxes.same(
            u, None if reference is None else np.array(reference)
        )
        if len(a) <= 2 and kind in ("random", "small integers", "empty") and number % 5 == 0:
            exact = boxes.exactly_nearest_in_box(program)
            self._compare(IN_BOX, exact is None, u is None)
            if exact is not None and u is not None:
                self._measure(IN_BOX, float(np.abs(u - exact).max()))
        return packed_box(np.array([u_nom, weights, low, high, a]), bound)

    def violation(self, number: int) -> bytes:
        """Draw rows that mostly no input keeps, try them and pack the program of C."""
        kind, rng = violations.KINDS[number % len(violations.KINDS)], self._rng
        m = int(rng.integers(1, 5))
        inputs, rows = violations.draw_rows(
            kind, m, int(rng.choice([1, 2, 4, 8, 16][: 8 - m])), rng
        )
        packed = list[bytes]()

        def vertex(A: Array, b: Array) -> list[float] | None:
            packed.append(packed_vertex(np.concatenate([A, b[:, None]], axis=1)))
            return self._vertex(A, b)

        u = violation.least_violation(inputs, rows, vertex)
        self.counts[VIOLATION] += 1
        if m * len(rows.bound) <= 24:
            self.counts[f"{VIOLATION}, also in Python"] += 1
            reference = violation.least_violation(inputs, rows)
            self.counts[f"{VIOLATION}, with other bits in Python"] += not boxes.same(u, reference)
        if m <= 2 and len(rows.bound) <= 4 and kind not in ("unknown", "large"):
            least = violations.exactly_least(inputs, rows)
            self.counts[f"{VIOLATION}, by rational numbers"] += 1
            self._measure(VIOLATION, float(violations.exact_violation(rows, u) - least))
        return packed[0]

    def _compare(self, what: str, empty: bool, other: bool) -> None:
        self.counts[f"{what}, by rational numbers"] += 1
        self.counts[f"{what}, with another emptiness"] += empty is not other

    def _measure(self, what: str, distance: float) -> None:
        name = f"rational numbers, {what}"
        self.farthest[name] = max(self.farthest[name], distance)
