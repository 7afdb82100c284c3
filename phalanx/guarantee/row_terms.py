"""The terms of one pair's row apart, by the expressions that the filter's row is compiled from.

c_i u_i + motion + allowance + the other's worst + margin <= 0. The margin is split by what is left
of it without disturbance, then without jitter too; a given η is one term. Terms of a half row are
halves.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.swarm.rows import SafetyRows
from phalanx.theory.arrays import Array
from phalanx.theory.margins.margin import RowPart
from phalanx.theory.rows.pairs import most_of_other
from phalanx.theory.safety.pairs import spread

MOTION, ALLOWANCE, ADVERSARY = "motion without inputs", "allowance α(ψ)", "the other at its worst"
GIVEN, PERIOD = "margin: η as given", "margin: sampling period"
JITTER, DISTURBANCE = "margin: jitter", "margin: disturbance"


class RowTerms(NamedTuple):
    """A pair's row at one state."""

    a: Array
    """c_i, shape (m_i,)."""
    forces: Array
    """c_l of the other member, shape (m_l,); empty for an obstacle."""
    terms: Mapping[str, float]
    """In the unit of h per second to the q."""
    per_metre: float
    """Change of the allowance by one more metre between the two."""


class PairRowTerms:
    """Terms of agent i's row of one pair, at any state."""

    def __init__(self, rows: SafetyRows, i: int, other: int, part: RowPart) -> None:
        """other: a member, or N + k for obstacle k."""
        swarm = rows.swarm
        pair, margin = rows.own_pair(i, other, plain=False), rows.margin(i)
        chain, side, share = pair.chain, pair.side, part.value
        quiet = replace(margin, bounds=dict.fromkeys(margin.bounds, 0.0))
        calm = replace(quiet, horizon=swarm.horizon(i) - swarm.groups[i].clock.jitter)
        eta, without_phi, period = (m.of(chain, side, part) for m in (margin, quiet, calm))
        terms = {
            MOTION: share * ca.sum1(chain.drift),
            ALLOWANCE: share * chain.alpha,
            ADVERSARY: most_of_other(pair) if part is RowPart.WHOLE else ca.SX(0),
            GIVEN: ca.SX(share * margin.eta),
            PERIOD: period - share * margin.eta,
            JITTER: without_phi - period,
            DISTURBANCE: eta - without_phi,
        }
        slope = ca.SX(share)
        for alpha, psi in zip(swarm.safety.class_k, chain.psi, strict=True):
            s = ca.SX.sym("s")
            slope *= ca.substitute(ca.jacobian(alpha.value(s), s), s, psi)
        moves = ca.jacobian(chain.set.positions[side], chain.set.x)
        gradient = ca.solve(moves @ moves.T, moves @ ca.jacobian(chain.psi[0], chain.set.x).T)
        forces = ca.SX(1, 0) if pair.other is None else chain.actuation[pair.other]
        x = ca.vertcat(chain.set.x, chain.set.parameters)
        values = ca.vertcat(*terms.values(), slope * ca.norm_2(gradient))
        self._names, self._parameters = tuple(terms), swarm.pairs.parameters
        self._evaluate = ca.Function("terms", [x], [values, chain.actuation[side], forces])
        ends = np.array([swarm.pairs.ordered(i, other)])
        (self._numbers,) = spread(swarm.pairs.begin, ends, chain.set.sizes)

    def __call__(self, x: Array) -> RowTerms:
        """Evaluate at a stacked state, shape (n̄,), of which only the pair's part counts."""
        numbers = np.concatenate([x, self._parameters])[self._numbers]
        values, a, forces = (np.array(v).ravel() for v in self._evaluate(numbers))
        *terms, per_metre = values.tolist()
        return RowTerms(a, forces, dict(zip(self._names, terms, strict=True)), per_metre)
