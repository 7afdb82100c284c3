"""The pairs a run was about: those that were the worst one of some agent at some state."""

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.swarm import Swarm

_AT_ONCE = 64
"""States whose pairs are evaluated together."""


def near_pairs(swarm: Swarm, x: Array) -> tuple[list[int], Array]:
    """These pairs, by index in the composed set, and their h.

    Args:
        swarm: whose pairs they are.
        x: states, shape (s, n̄).

    Returns:
        The pairs' indices, r of them; and h, shape (s, r).
    """
    pairs = swarm.pairs.among(range(len(swarm.members)))
    every = swarm.pairs.choose(pairs)
    mine = [np.flatnonzero((every.pairs == i).any(axis=1)) for i in swarm.normal]
    worst: set[int] = set()
    for begin in range(0, len(x), _AT_ONCE):
        h = every.h(x[begin : begin + _AT_ONCE])
        for own in mine:
            worst.update(every.order[own[h[:, own].argmax(axis=1)]].tolist() if len(own) else ())
    found = sorted(worst)
    chosen = swarm.pairs.choose(pairs[found])
    h = np.empty((len(x), len(found)))
    h[:, chosen.order] = chosen.h(x)
    return found, h
