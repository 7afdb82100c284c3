"""Polytopes at random, as inequalities whose rows have any length."""

import numpy as np


def random_polytope(rng: np.random.Generator, m: int) -> tuple[np.ndarray, np.ndarray]:
    """A box cut by half-spaces that keep its centre, anywhere, rows of any length."""
    cuts = rng.normal(size=(rng.integers(0, 5), m))
    A = np.vstack([np.eye(m), -np.eye(m), cuts])
    b = rng.uniform(0.1, 3.0, len(A)) * np.linalg.norm(A, axis=1)
    b += A @ rng.uniform(-2, 2, m)
    scale = 10.0 ** rng.uniform(-2, 2, len(A))
    order = rng.permutation(len(A))
    return (A * scale[:, None])[order], (b * scale)[order]
