"""Which links a partition cuts: Jepsen's shapes."""

import itertools
from collections.abc import Sequence
from typing import Literal

from phalanx.seeded.draws import Draws

Link = tuple[str, str]
"""Sender and receiver."""
Shape = Literal["majority", "ring", "isolate"]


def between(groups: Sequence[Sequence[str]], one_way: bool = False) -> frozenset[Link]:
    """Links between different groups; one way: only those out of the first group."""
    return frozenset(
        (sender, receiver)
        for place, (a, b) in enumerate(itertools.permutations(groups, 2))
        if not one_way or place < len(groups) - 1
        for sender in a
        for receiver in b
    )


def shaped(shape: Shape, names: Sequence[str], draws: Draws) -> frozenset[Link]:
    """The links that a shape cuts, its agents drawn at random.

    majority: two halves, the first larger by one or two. ring: everybody hears a majority, and no
    two the same one. isolate: one agent alone.
    """
    order = sorted(names, key=lambda name: float(draws[names.index(name)][0]))
    majority = len(order) // 2 + 1
    if shape == "majority":
        return between([order[:majority], order[majority:]])
    if shape == "isolate":
        return between([order[:1], order[1:]])
    heard = {
        (order[(place + ahead) % len(order)], receiver)
        for place, receiver in enumerate(order)
        for ahead in range(majority)
    }
    return frozenset(link for link in itertools.permutations(order, 2) if link not in heard)
