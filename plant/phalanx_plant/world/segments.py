"""The world's motion as columns: all segments of consecutive histories, one after the other."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from phalanx.theory.arrays import Array, Index, joined
from phalanx_plant.world.world import History, Segment


class Segments(NamedTuple):
    """k segments with s integration steps in all; see Segment."""

    history: Index
    """Number of each segment's history, shape (k,)."""
    t: Array
    """[s]"""
    dt: Array
    """[s]"""
    counts: Index
    """Steps of each, shape (k,)."""
    phi: Array
    slope: Array
    u: Array
    start: Array
    """Each stacked, shape (k, n̄) or (k, m̄)."""
    x: Array
    """After each step, shape (s, n̄)."""
    p: Array
    """After each step [m], shape (s, N, d)."""

    def between(self, begin: int, end: int) -> "Segments":
        """Return the segments from one to before another."""
        ends = np.append(0, np.cumsum(self.counts))
        steps = slice(ends[begin], ends[end])
        return Segments._make([*(c[begin:end] for c in self[:8]), self.x[steps], self.p[steps]])

    def and_then(self, more: "Segments") -> "Segments":
        """Return these segments and more."""
        return Segments._make(np.concatenate(both) for both in zip(self, more, strict=True))


def segments_of(histories: Sequence[History]) -> Segments | None:
    """Return the segments of consecutive histories; None if there is none."""
    numbered = [(k, p) for k, history in enumerate(histories) for p in history
                if type(p) is Segment]  # fmt: skip
    if not numbered:
        return None
    numbers, pieces = zip(*numbered, strict=True)
    names = "phi", "slope", "u", "start"
    counts = np.array([len(p.x) for p in pieces])
    phi, slope, u, start = (
        joined([getattr(p, name) for p in pieces], len(pieces), -1) for name in names
    )
    return Segments(
        np.array(numbers, dtype=np.intp),
        np.array([p.t for p in pieces]),
        np.array([p.dt for p in pieces]),
        counts, phi, slope, u, start,
        np.concatenate([p.x for p in pieces]),
        np.concatenate([p.p for p in pieces]),
    )  # fmt: skip
