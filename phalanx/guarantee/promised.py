"""The time that is promised before a run: no pair can become unsafe sooner, whatever agents do.

Boxes hold all states that the members of a pair can reach from x(0), with all inputs and all
disturbances within their bounds. While h <= 0 over the boxes the pair is safe, under any filter,
attack and network.
"""

from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array, Index
from phalanx.guarantee.certificate import DEFECT, highest_within
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.swarm.swarm import Swarm
from phalanx.theory.safety.pairs import spread

_HALVINGS = 16
"""Bisections of the run's duration."""


class Promise(NamedTuple):
    """The time for which all pairs are safe, proven before the run."""

    time: float
    """[s]; 0 if nothing is proven, at most the run's duration."""
    pair: str
    """Label of a pair that may be unsafe soon after; empty if there is none."""

    def __str__(self) -> str:
        """Return the promise as a sentence."""
        if not self.time:
            return f"Nothing is promised ahead: no time is proven for {self.pair} at the start."
        rounded_down = np.floor(1e3 * self.time) / 1e3
        meets = f" {self.pair} could be unsafe soon after, if its members did their worst."
        return (
            f"Promised for the first {rounded_down:.3f} s: until then every pair is safe, whatever "
            f"all agents do within their inputs.{meets if self.pair else ''}"
        )


def promised(swarm: Swarm) -> Promise:
    """Return the time that is promised from x(0) on. A pair without a bound makes it 0."""
    x, safe, unknown = swarm.start(), 0.0, swarm.scenario.duration
    first = _unproven(swarm, x, unknown)
    if not len(first):
        return Promise(unknown, "")
    for _ in range(_HALVINGS):
        middle = 0.5 * (safe + unknown)
        found = _unproven(swarm, x, middle)
        if len(found):
            first, unknown = found, middle
        else:
            safe = middle
    return Promise(safe, swarm.safe_set.label(swarm.safe_set.pairs[int(first[0])]))


def _unproven(swarm: Swarm, x: Array, time: float) -> Index:
    """Return the pairs with a normal agent for which h <= 0 is not proven up to a time [s].

    x: x(0), shape (n̄,).
    """
    certificates = swarm.once(SwarmCertificates)
    ends, sorts = certificates.ends, certificates.sorts
    mine = np.isin(ends, swarm.normal).any(axis=1)
    numbers = swarm.pairs.numbers(x[None]).ravel()
    found = [np.empty(0, dtype=np.intp)]
    for sort in np.unique(sorts[mine]).tolist():
        which = np.flatnonzero(mine & (sorts == sort))
        a, b = ends[which[0]].tolist()
        alone = swarm.pairs.alone(a, b)
        names = [swarm.names[l] for l in (a, b) if l < len(swarm.members)]
        bounds = [swarm.disturbance_bounds[name] + DEFECT for name in names]
        highest = highest_within(alone, bounds, time)
        if highest is None:
            found.append(which)
            continue
        h = highest(numbers, spread(swarm.pairs.begin, ends[which], alone.sizes))[:, 0]
        found.append(which[~(h <= 0.0)])
    return np.sort(np.concatenate(found))
