"""Try the exact minimiser on many programs: against OSQP, rationals, hints and other compilers.

    python -m evidence.minimiser.agreement [PROGRAMS] [SEED]

Programs have 1 to 8 inputs and 1 to 256 rows: random, degenerate (rows through one point),
parallel, nearly empty and empty. As many in a box under one row, and a tenth as many of the least
worst violation, are compared with Python and with rationals. Compilers: cc, cc -O3 for this
processor, the one of `pip install ziglang`, and AArch64 under emulation, as far as they are
installed.
"""

import ctypes
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import osqp
from rich.progress import track
from scipy import sparse

from evidence.minimiser.compilers import COMPILERS, hash_by, library, packed_point
from evidence.minimiser.small_programs import SmallTrial
from phalanx.theory.arrays import Array
from phalanx.theory.rows import nearest_point as module
from phalanx.theory.rows.nearest_point import NearestPoint
from tests.unit.theory.rows.test_nearest_point import KINDS, draw_program, exactly_nearest

Program = tuple[list[float], Array, Array, float]


class Trial:
    """Counts of what was tried, and the farthest that another answer was."""

    def __init__(self, rng: np.random.Generator, folder: Path) -> None:
        self.counts: Counter[str] = Counter()
        self.farthest = {"OSQP": 0.0, "rational numbers": 0.0}
        self._rng, self._in_c = rng, module.CompiledPoint(ctypes.PyDLL(str(library(folder))))

    def program(self, number: int) -> bytes:
        """Draw a program, try it in all ways that it is small enough for, and pack it."""
        kind, rng = KINDS[number % len(KINDS)], self._rng
        m, rows = int(rng.integers(1, 9)), int(rng.choice([1, 2, 4, 8, 16, 64, 256]))
        program: Program = draw_program(kind, m, rows, rng)
        answer = self._in_c(*program, None)
        self.counts["empty"] += answer is None
        self._hints(program, answer)
        if number % 20 == 0:
            self.counts["by the Python reference"] += 1
            self.counts["with other bits in Python"] += module.nearest_point(*program) != answer
        if kind == "random" and max(map(abs, program[0])) < 100.0 and answer is not None:
            self._by_osqp(program, answer)
        if kind in ("random", "empty") and m <= 3 and rows <= 4:
            self._by_rational_numbers(program, answer)
        return packed_point(*program)

    def _hints(self, program: Program, answer: NearestPoint | None) -> None:
        m, rows = len(program[0]), len(program[2])
        sizes = self._rng.integers(0, m + 1, 5).tolist()
        draws = [self._rng.choice(rows, size, replace=False).tolist() for size in sizes]
        hints = [tuple(sorted(draw)) for draw in draws]
        for hint in [*hints, *([answer.rows] if answer else [])]:
            point = self._in_c(*program, hint)
            self.counts["hints"] += 1
            self.counts["hints that end the search"] += point is not None
            self.counts["hints with other bits"] += point not in (None, answer)

    def _by_osqp(self, program: Program, answer: NearestPoint) -> None:
        n, G, g, _ = program
        solver = osqp.OSQP(algebra="builtin")
        options = {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 100_000, "verbose": False}
        matrices = sparse.eye(len(n), format="csc"), -np.array(n), sparse.csc_matrix(G)
        solver.setup(*matrices, np.full(len(g), -np.inf), g, **options)
        solution = solver.solve()
        self.counts["by OSQP"] += 1
        if solution.info.status == "solved":
            self._measure("OSQP", solution.x, answer)
        else:
            self.counts["without an answer of OSQP"] += 1

    def _by_rational_numbers(self, program: Program, answer: NearestPoint | None) -> None:
        exact = exactly_nearest(*program[:3])
        self.counts["by rational numbers"] += 1
        self.counts["with another emptiness"] += (exact is None) != (answer is None)
        if exact is not None and answer is not None:
            self._measure("rational numbers", [float(x) for x in exact], answer)

    def _measure(self, name: str, point: Sequence[float], answer: NearestPoint) -> None:
        distance = float(np.abs(np.array(point) - answer.v).max())
        self.farthest[name] = max(self.farthest[name], distance)


def main(count: int = 100_000, seed: int = 0) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder, rng = Path(name), np.random.default_rng(seed)
        trial, small = Trial(rng, folder), SmallTrial(rng, folder)
        programs = [trial.program(number) for number in track(range(count), "programs")]
        programs += [small.in_box(number) for number in track(range(count), "in a box")]
        programs += [small.violation(number) for number in track(range(count // 10), "violations")]
        print(f"{count} programs")
        for what, number in {**trial.counts, **small.counts}.items():
            print(f"  {what}: {number}")
        for what, distance in (trial.farthest | small.farthest).items():
            print(f"  farthest from {what}: {distance:.1e}")
        data = b"".join(programs)
        for compiler in COMPILERS:
            print(f"  {compiler}: {hash_by(compiler, data, folder)}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
