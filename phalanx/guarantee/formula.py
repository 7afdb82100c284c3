"""η by the paper's formula, from constants over the workspace: of h_tot, and of each pair alone."""

from typing import NamedTuple

import numpy as np

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows
from phalanx.theory.margins.constants import Constant, constants, margin_constants
from phalanx.theory.safety.chain import Chain


class Region(NamedTuple):
    """Where the constants are to hold."""

    low: Array
    """shape (n̄,)"""
    high: Array
    samples: Array
    """States in S_I, shape (s, n̄), for constants that interval arithmetic does not bound."""


class Formula(NamedTuple):
    """The margin of one row for as long as any agent's input may be in force."""

    constants: dict[str, Constant]
    eta: float
    """Eq. (mainetadef), or (etaprimedef) for q > 1."""
    corrected: float
    """The same with L_φ ψ_{q-1} bounded over the workspace."""

    @property
    def proven(self) -> bool:
        """Whether every constant is a bound."""
        return all(constant.how == "interval" for constant in self.constants.values())


def formula(rows: SafetyRows, chain: Chain, region: Region) -> Formula:
    """η from the constants of one chain: of h_tot, or of a pair.

    Raises:
        ValueError: a member's input polytope depends on its state.
    """
    swarm, composed = rows.swarm, rows.swarm.safe_set
    places = [swarm.names.index(m.name) for m in chain.set.members]
    own = np.concatenate([np.r_[composed.parts[l]] for l in places])
    bounds = [swarm.disturbance_bounds[m.name] for m in chain.set.members]
    low, high, samples = region.low[own], region.high[own], region.samples[:, own]
    found = constants(chain, low, high, bounds, samples)
    longest = max(swarm.horizon(i) for i in swarm.normal)
    given = margin_constants(found)
    sampling, whole = given.eta(longest, 0.0), given.eta(longest, sum(bounds))
    return Formula(found, whole if chain.relative_degree == 1 else sampling, whole)


def worst_pair(rows: SafetyRows, region: Region) -> Formula:
    """The pair that needs the largest margin, of those that normal agents keep rows for.

    Pairs of members of the same two groups differ in nothing that counts.
    """
    swarm, found = rows.swarm, {}
    for number, pair in enumerate(swarm.safe_set.pairs):
        groups = [id(swarm.groups[l]) for l in (pair.a, pair.b) if l is not None]
        alike = (*groups, pair.obstacle)
        normal = any(l in swarm.normal for l in (pair.a, pair.b))
        if normal and alike not in found:
            found[alike] = formula(rows, rows.pair_chain(number), region)
    return max(found.values(), key=lambda f: f.corrected)
