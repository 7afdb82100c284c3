"""Which K_i(x(0)) are non-empty, as the scenario has them and as they can be proven."""

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.decision import least_violation
from phalanx.theory.rows.information import Information
from phalanx.theory.rows.pairs import HALF, PairTerms, PairTermsFunction, pair_rows
from phalanx.theory.rows.terms import TermsFunction

Array = NDArray[np.float64]

_SHORTEST, _LONGEST, _BISECTIONS = 1e-6, 10.0, 20
"""The sampling gaps that are looked among [s], and how closely."""


def rows_at_start(swarm: Swarm) -> dict[str, bool]:
    """By normal agent: whether K_i(x(0)) is non-empty, with nothing received yet."""
    x = swarm.start()
    return {swarm.names[i]: _feasible(swarm, i, x) for i in swarm.normal}


def rigorous(swarm: Swarm) -> Swarm:
    """The same scenario with half rows for each pair and the local margin."""
    scenario = swarm.scenario
    proven = {
        "composition": "pairs",
        "margin": "local",
        "margin_scale": 1.0,
        "eta": 0.0,
        "information": Information.SPLIT,
        "neighbourhood": None,
    }
    safety = scenario.safety.model_copy(update=proven)
    return build_swarm(scenario.model_copy(update={"safety": safety}))


def _feasible(swarm: Swarm, i: int, x: Array) -> bool:
    """Whether K_i(x) is non-empty, with nothing received."""
    safety = swarm.scenario.safety
    terms = swarm.terms(i)(x)
    if swarm.pair_chains:
        return _pairs_feasible(swarm, i, swarm.pair_terms(i)(x), terms.polytopes[i])
    total = terms.unforced + safety.margin_scale * (swarm.eta(i) + terms.margin)
    for l in range(len(swarm.members)):
        helps = l == i or (swarm.joint and l in swarm.normal)
        total += float(terms.least[l] if helps else terms.most[l])
    return total <= 0


def _pairs_feasible(swarm: Swarm, i: int, terms: PairTerms, inputs: Polytope) -> bool:
    safety = swarm.scenario.safety
    sharing = list(swarm.normal) if swarm.joint else []
    scale = safety.margin_scale
    rows = pair_rows(terms, swarm.own_pairs(i), {}, sharing, swarm.eta(i), scale)
    u = least_violation(inputs, rows)
    return bool((rows.a @ u <= rows.bound).all())


class ProvenRows:
    """One agent's half rows for each pair with the local margin, at x(0), for any sampling gap."""

    def __init__(self, swarm: Swarm, i: int, x: Array) -> None:
        """swarm: as rigorous() has it."""
        self._swarm, self._i, self._x = swarm, i, x
        pairs, gap = swarm.own_pairs(i), ca.SX.sym("gap")
        shares = [HALF if p.shared else None for p in pairs]
        margins = [
            swarm.local_margin(p.chain, p.own, share, gap)
            for p, share in zip(pairs, shares, strict=True)
        ]
        composed = swarm.chain.set
        self._margins = CompiledFunction([composed.x, gap], [ca.vertcat(*margins)])
        zero = [(0.0, 0.0)] * len(pairs)
        self._terms = PairTermsFunction(composed, pairs, zero, None)(x)
        self._inputs = TermsFunction(swarm.chain)(x).polytopes[i]

    def margin(self, gap: float) -> float:
        """The largest margin of any row."""
        return float(self._margins(self._x, gap)[0].max())

    def feasible(self, gap: float) -> bool:
        """Whether K_i(x(0)) is non-empty."""
        margins = self._margins(self._x, gap)[0]
        terms = self._terms._replace(margin=margins, half_margin=margins)
        return _pairs_feasible(self._swarm, self._i, terms, self._inputs)


def largest_gap(rows: Sequence[ProvenRows]) -> float | None:
    """By bisection; the margin grows with the gap."""

    def holds(gap: float) -> bool:
        return all(row.feasible(gap) for row in rows)

    low, high = _SHORTEST, _LONGEST
    if not holds(low):
        return None
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
