"""Feasibility of rows at x(0): of the scenario's rows, and of rows that can be proven."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linprog

from phalanx.arrays import Array
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.expressions.exact import dot, length
from phalanx.theory.laws.law import NominalInput, View
from phalanx.theory.models.polytope import Polytope
from phalanx.theory.rows.decision import least_violation
from phalanx.theory.rows.information import Information
from phalanx.theory.rows.pairs import PairTerms, pair_rows
from phalanx.theory.rows.row import Rows, joint_sum
from phalanx.theory.rows.safety_filter import FilterInput

_FEW_ROWS = 8
"""Up to so many rows all vertices are enumerated: 2 ms for three inputs. For 32 rows that takes
230 ms, and a linear program 2 ms."""
_SHORTEST, _LONGEST, _BISECTIONS = 1e-6, 10.0, 20
"""Range of sampling gaps [s], and steps of the search."""


def rows_at_start(rows: SafetyRows) -> dict[str, bool]:
    """Return for each normal agent whether K_i(x(0)) is non-empty, with nothing received yet.

    Agents with a controller of their own have no K_i.
    """
    swarm = rows.swarm
    x = swarm.start()
    filtered = [i for i in swarm.normal if swarm.groups[i].controller is None]
    return {swarm.names[i]: _feasible(rows, i, x) for i in filtered}


def rigorous(swarm: Swarm) -> SafetyRows:
    """Build the rows that can be proven: half rows for each pair, local margin."""
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
    return build_rows(build_swarm(scenario.model_copy(update={"safety": safety})))


def with_information(swarm: Swarm, information: Information) -> SafetyRows:
    """Build the rows of the same swarm with another information model."""
    safety = swarm.safety.model_copy(update={"information": information})
    return build_rows(build_swarm(swarm.scenario.model_copy(update={"safety": safety})))


def effort_at_start(rows: SafetyRows) -> float:
    """Return the mean ‖u - u_nom‖ of normal agents at x(0), with nothing received yet."""
    x = rows.swarm.start()
    return float(np.mean([_effort(rows.seen_by(i), i, x) for i in rows.swarm.normal]))


def _effort(rows: SafetyRows, i: int, x: Array) -> float:
    swarm, seen = rows.swarm, rows.swarm.seen(i, x)
    states = {l: x[swarm.safe_set.parts[l]] for l in seen}
    terms, normal = rows.terms(i)(x, seen), [l for l in seen if l in swarm.normal]
    view = View(i, states, normal, swarm.goal(i)(0.0, states), terms, 0.0)
    u_nom = NominalInput(swarm.law(i), swarm.members[i])(view)
    u = rows.filter(i)(FilterInput(swarm.time.latency, x, seen, terms, u_nom, {})).decision.u
    return float(length(u - u_nom))


def _feasible(rows: SafetyRows, i: int, x: Array) -> bool:
    """Return whether K_i(x) is non-empty, with nothing received."""
    rows = rows.seen_by(i)
    swarm, seen = rows.swarm, rows.swarm.seen(i, x)
    terms = rows.terms(i)(x, seen)
    if swarm.safety.pairwise:
        sharing = swarm.normal if swarm.safety.joint else ()
        return _pairs_feasible(rows.pair_terms(i)(x, seen, sharing), terms.polytopes[i])
    if (margin := rows.share_margin(i)) is not None:
        return joint_sum(terms, swarm.normal) + margin(x, terms, swarm.normal) <= 0
    return joint_sum(terms, swarm.normal if swarm.safety.joint else (i,)) <= 0


def _pairs_feasible(terms: PairTerms, inputs: Polytope) -> bool:
    every = pair_rows(terms, {})
    # Rows of pairs far apart hold for every input.
    binding = ~(dot(every.a[:, None], inputs.corners).max(axis=1, initial=-np.inf) <= every.bound)
    rows = Rows(every.a[binding], every.bound[binding])
    if not len(rows.bound) or not np.isfinite(rows.bound).all():
        return not len(rows.bound)
    if len(rows.bound) > _FEW_ROWS:
        return _solvable(inputs, rows)
    u = least_violation(inputs, rows)
    return bool((rows.a @ u <= rows.bound).all())


def _solvable(inputs: Polytope, rows: Rows) -> bool:
    """Return whether some input satisfies the rows, by a linear program, to the solver's 1e-7."""
    A, b = np.concatenate([inputs.A, rows.a]), np.concatenate([inputs.b, rows.bound])
    found = linprog(np.zeros(A.shape[1]), A_ub=A, b_ub=b, bounds=(None, None))
    return bool(found.status == 0)


class ProvenRows:
    """One agent's half rows for each pair with the local margin, at x(0), for any sampling gap."""

    def __init__(self, rows: SafetyRows, i: int, x: Array) -> None:
        """rows: from rigorous()."""
        self._x, self._seen, self._sharing = x, rows.swarm.seen(i, x), rows.swarm.normal
        self._terms = rows.pair_terms_of_gap(i)
        self._inputs = rows.terms(i)(x, self._seen).polytopes[i]

    def margin(self, gap: float) -> float:
        """Return the largest margin of any row."""
        return float(self._at(gap).margin.max(initial=0.0))

    def feasible(self, gap: float) -> bool:
        """Return whether K_i(x(0)) is non-empty."""
        return _pairs_feasible(self._at(gap), self._inputs)

    def _at(self, gap: float) -> PairTerms:
        return self._terms(self._x, self._seen, self._sharing, [gap])


def largest_gap(rows: Sequence[ProvenRows]) -> float | None:
    """Return the largest feasible gap [s], by bisection, since the margin grows with the gap."""

    def holds(gap: float) -> bool:
        return all(row.feasible(gap) for row in rows)

    low, high = _SHORTEST, _LONGEST
    if not holds(low):
        return None
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low
