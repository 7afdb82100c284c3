"""Measure the CPU time of a decision under 5 and 64 rows, and where its backup acts.

    phalanx compile unicycles && python bench/speed/several_rows.py

Rows turn and the nominal input moves from step to step, as those of a robot do. In a checkout of
another version, called alternately, it compares that one.
"""

import time
from collections.abc import Callable, Iterator

import numpy as np

from phalanx.theory.arrays import Array
from phalanx.theory.models.polytope import polytope
from phalanx.theory.rows.decision import decide_pairs
from phalanx.theory.rows.origin import Origin
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import Rows

SQUARE = polytope(np.vstack([np.eye(2), -np.eye(2)]), np.ones(4))
POINT = np.array([0.2, -0.1])
"""An input that keeps all rows of a feasible program."""
STEPS, BACKUPS = 3000, {5: 150, 64: 12}
WARM_UP = 0.04
"""Share of the steps that is not counted."""

Program = tuple[Rows, Array]


def feasible(count: int) -> Iterator[Program]:
    """Rows that POINT keeps, and nominal inputs."""
    a, slack = turning(count)
    for k in range(STEPS):
        bound = slack * (1.0 + 0.3 * np.sin(0.02 * k))
        u_nom = 1.5 * np.array([np.cos(0.01 * k), np.sin(0.013 * k)])
        yield Rows(a(k), bound + a(k) @ POINT), u_nom


def empty(count: int) -> Iterator[Program]:
    """Rows that together no input keeps."""
    a, slack = turning(count)
    for k in range(BACKUPS[count]):
        yield Rows(a(k), -2.0 - slack * (1.0 + 0.3 * np.sin(0.02 * k))), np.zeros(2)


def turning(count: int) -> tuple[Callable[[int], Array], Array]:
    """Rows' normals at a step, and their slacks."""
    rng = np.random.default_rng(0)
    base, drift = rng.normal(size=(2, count, 2))
    return lambda k: base + 0.3 * np.sin(0.004 * k) * drift, rng.uniform(0.05, 1.0, count)


def main() -> None:
    """Print a table."""
    print("| rows | origin | p50 [µs] | p99 [µs] |")
    print("|---|---|---|---|")
    for count in BACKUPS:
        for programs, origin in ((feasible, Origin.QP), (empty, Origin.BACKUP)):
            qp, times = NearestInput((1.0, 1.0)), []
            for rows, u_nom in programs(count):
                begin = time.thread_time()
                decision = decide_pairs(SQUARE, rows, u_nom, qp)
                times.append(time.thread_time() - begin)
                assert decision.origin is origin
            counted = np.array(times[int(WARM_UP * len(times)) :]) * 1e6
            p50, p99 = np.percentile(counted, [50, 99])
            print(f"| {count} | {origin.value} | {p50:.0f} | {p99:.0f} |")


if __name__ == "__main__":
    main()
