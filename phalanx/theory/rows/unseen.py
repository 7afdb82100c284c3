"""Where an expression of everybody's state is evaluated by an agent that does not see everybody."""

from collections.abc import Sequence

from phalanx.arrays import Array

_FAR = 1e6


def with_unseen_far(x: Array, parts: Sequence[slice], seen: Sequence[int] | None) -> Array:
    """The stacked state x, shape (n̄,), with every member that is not seen too far away to count.

    Args:
        x: NaN where it is not known.
        parts: where each member's state lies in x.
        seen: the members that are seen; None for all.
    """
    if seen is None or len(seen) == len(parts):
        return x
    far, known = x.copy(), set(seen)
    for l, part in enumerate(parts):
        if l not in known:
            # Each in a place of its own: two in one place are at no distance that has a gradient.
            far[part] = _FAR * (1 + l)
    return far
