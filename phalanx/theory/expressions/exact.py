"""Linear algebra on small arrays whose bits do not depend on the machine.

BLAS and LAPACK pick a kernel by the CPU, and kernels add in different orders, with fused
multiplications or without; builtin sum() compensates from Python 3.12 on. Here every product is
rounded by itself and sums run in one fixed order, so that a run has one trajectory everywhere.
"""

from collections.abc import Iterable, Sequence
from operator import mul

import numpy as np

from phalanx.theory.arrays import Array

LARGEST = 1e300
"""Bound on the size of reported numbers, of a law's input and of the true state."""
LARGEST_SUM = 1e303
"""Bound on the size of recorded numbers that are computed from a few of those."""


def dot(a: Array, b: Array) -> Array:
    """Σ a b over the last axis, the others broadcast: A x is dot(A, x), A Bᵀ dot(A[:, None], B).

    >>> dot(np.array([[1.0, 2.0], [0.0, 1.0]]), np.array([3.0, 4.0]))
    array([11.,  4.])
    """
    # np.add.reduce does not call BLAS, and its order of pairwise sums is the same for any SIMD.
    total: Array = np.add.reduce(a * b, axis=-1)
    return total


def inner(a: Sequence[float], b: Sequence[float]) -> float:
    """dot of two short vectors: as plain numbers it takes a third of the time."""
    return added(map(mul, a, b))


def length(a: Array) -> Array:
    """Euclidean length along the last axis.

    >>> length(np.array([[3.0, 4.0], [0.0, 2.0]]))
    array([5., 2.])
    """
    norm: Array = np.sqrt(dot(a, a))
    return norm


def added(values: Iterable[float]) -> float:
    """The sum from left to right, each step rounded.

    >>> added([0.5, 0.25, 1.0])
    1.75
    """
    total = 0.0
    for value in values:
        total += value
    return total


def solve(A: Array, b: Array) -> tuple[Array, Array]:
    """Solutions of k systems A x = b by Gaussian elimination with partial pivoting.

    Args:
        A: shape (k, m, m). b: shape (k, m).

    Returns:
        x, shape (k, m), not finite where A is singular, and det A, shape (k,).
    """
    k, m = b.shape
    every, determinant = np.arange(k), np.ones(k)
    rows = np.concatenate([A, b[..., None]], axis=2)
    x = np.empty((k, m))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for c in range(m):
            pivot = c + np.abs(rows[:, c:, c]).argmax(axis=1)
            chosen = rows[every, pivot]
            rows[every, pivot] = rows[:, c]
            rows[:, c] = chosen
            determinant *= np.where(pivot == c, chosen[:, c], -chosen[:, c])
            factors = rows[:, c + 1 :, c] / chosen[:, None, c]
            rows[:, c + 1 :] -= factors[..., None] * chosen[:, None]
        for c in reversed(range(m)):
            sums = dot(rows[:, c, c + 1 : m], x[:, c + 1 :])
            x[:, c] = (rows[:, c, m] - sums) / rows[:, c, c]
    return x, determinant
