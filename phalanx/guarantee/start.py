"""Facts of x(0), before any run: rows with a solution, certificates, and a promised time.

The rows are those of the scenario, or those that can be proven. The promise needs neither: boxes
hold all states that the members of a pair can reach from x(0), with all inputs and all disturbances
within their bounds. While h <= 0 over the boxes the pair is safe, under any filter, attack and
network.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from phalanx.guarantee.certificate import highest_within
from phalanx.guarantee.certificates import SwarmCertificates
from phalanx.swarm.rows import SafetyRows, build_rows
from phalanx.swarm.runnable import first_nominal
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import length
from phalanx.theory.models.polytope import Polytope, constant_polytope
from phalanx.theory.rows.pairs import PairTerms, pair_rows
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.row import joint_sum
from phalanx.theory.rows.safety_filter import FilterInput
from phalanx.theory.safety.pairs import spread

_SHORTEST, _LONGEST, _BISECTIONS = 1e-6, 10.0, 20
"""Range of sampling gaps [s], and steps of the search."""
_HALVINGS = 16
"""Bisections of the run's duration."""


def rows_at_start(rows: SafetyRows) -> dict[str, bool]:
    """Return for each normal agent whether K_i(x(0)) is non-empty, with nothing received yet.

    Agents with a controller of their own have no K_i.
    """
    swarm = rows.swarm
    x = swarm.start()
    filtered = [i for i in swarm.normal if swarm.groups[i].filtered]
    return {swarm.names[i]: _feasible(rows, i, x) for i in filtered}


def rigorous(swarm: Swarm) -> SafetyRows:
    """Build the rows that can be proven: half rows for each pair, local margin."""
    return with_safety(
        swarm,
        composition="pairs",
        margin="local",
        eta=0.0,
        information="split",
        neighbourhood=None,
    )


def with_safety(swarm: Swarm, **changes: object) -> SafetyRows:
    """Build the rows of the same swarm with other settings in [safety]."""
    safety = swarm.safety.model_copy(update=changes)
    return build_rows(build_swarm(swarm.scenario.model_copy(update={"safety": safety})))


def effort_at_start(rows: SafetyRows) -> float:
    """Return the mean ‖u - u_nom‖ of normal agents at x(0), with nothing received yet."""
    x = rows.swarm.start()
    return float(np.mean([_effort(rows.seen_by(i), i, x) for i in rows.swarm.normal]))


def _effort(rows: SafetyRows, i: int, x: Array) -> float:
    view, u_nom = first_nominal(rows, i, x)
    now = FilterInput(rows.swarm.time.latency, x, tuple(view.x), view.terms, u_nom, {})
    return float(length(rows.filter(i)(now).decision.u - u_nom))


def _feasible(rows: SafetyRows, i: int, x: Array) -> bool:
    """Return whether K_i(x) is non-empty, with nothing received."""
    rows = rows.seen_by(i)
    swarm, visible = rows.swarm, rows.swarm.seen(i, x)
    terms = rows.terms(i)(x, visible)
    if swarm.safety.pairwise:
        pairs = rows.pair_terms(i)(x, visible, swarm.sharing)
        return _pairs_feasible(pairs, terms.polytopes[i], rows.qp(i))
    return joint_sum(terms, swarm.sharing or (i,)) <= 0


def _pairs_feasible(terms: PairTerms, inputs: Polytope, qp: NearestInput) -> bool:
    """Ask the filter's own QP, so that the answer is that of a run's control steps."""
    return qp.solve(inputs.corners[0], inputs, pair_rows(terms, {})) is not None


class ProvenRows:
    """One agent's half rows for each pair with the local margin, at x(0), for any sampling gap."""

    def __init__(self, rows: SafetyRows, i: int, x: Array) -> None:
        """rows: from rigorous()."""
        self._x, self._visible, self._sharing = x, rows.swarm.seen(i, x), rows.swarm.normal
        self._terms = rows.pair_terms_of_gap(i)
        self._inputs, self._qp = rows.terms(i)(x, self._visible).polytopes[i], rows.qp(i)

    def margin(self, gap: float) -> float:
        """Return the largest margin of any row."""
        return float(self._at(gap).margin.max(initial=0.0))

    def feasible(self, gap: float) -> bool:
        """Return whether K_i(x(0)) is non-empty."""
        return _pairs_feasible(self._at(gap), self._inputs, self._qp)

    def _at(self, gap: float) -> PairTerms:
        return self._terms(self._x, self._visible, self._sharing, [gap])


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


class Promise(NamedTuple):
    """The time for which all pairs are safe, proven before the run."""

    time: float
    """[s]; 0 if nothing is proven, at most the run's duration."""
    pair: str
    """Label of a pair that may be unsafe soon after; empty if there is none."""
    times: Mapping[str, float] = {}
    """The same of each pair of which less than the run is proven, by its label."""

    def __str__(self) -> str:
        """Return the promise as a sentence."""
        if not self.time:
            return f"Nothing is promised ahead: no time is proven for {self.pair} at the start."
        rounded_down = np.floor(1e3 * self.time) / 1e3
        limit = f" Worst-case inputs of {self.pair} could make it unsafe after that."
        return (
            f"Promised for the first {rounded_down:.3f} s: until then every pair is safe, whatever "
            f"all agents do within their inputs.{limit if self.pair else ''}"
        )


def promised(swarm: Swarm) -> Promise:
    """Return the time that is promised from x(0) on. A pair without a bound makes it 0."""
    proven, duration = _proven(swarm, swarm.start()), swarm.scenario.duration
    safe = np.zeros(len(swarm.safe_set.pairs))
    unknown = safe + duration
    short = np.flatnonzero(~proven(unknown))
    if not len(short):
        return Promise(duration, "")
    for _ in range(_HALVINGS):
        middle = 0.5 * (safe + unknown)
        holds = proven(middle)
        safe, unknown = np.where(holds, middle, safe), np.where(holds, unknown, middle)
    times = {swarm.safe_set.label(swarm.safe_set.pairs[k]): float(safe[k]) for k in short.tolist()}
    first = min(times, key=lambda pair: times[pair])
    return Promise(times[first], first, times)


def _proven(swarm: Swarm, x: Array) -> Callable[[Array], Mask]:
    """Return times [s] -> the pairs for which h <= 0 is proven up to them, (p,); x: x(0), (n̄,)."""
    certificates, time = SwarmCertificates(swarm), ca.SX.sym("T")
    ends, sorts, numbers = certificates.ends, swarm.pair_sorts, swarm.pairs.numbers(x)
    bounds = list[tuple[Index, MappedFunction, Index]]()
    for sort in np.unique(sorts).tolist():
        pairs = np.flatnonzero(sorts == sort)
        alone = swarm.pairs.alone(*ends[pairs[0]].tolist())
        # Of any time: an expression is built once, and evaluated for each.
        within = highest_within(alone, certificates.bounds(alone), time)
        highest = MappedFunction([alone.x, alone.parameters, time], [within])
        indices = spread(swarm.pairs.begin, ends[pairs], alone.sizes)
        with_time = np.column_stack([indices, len(numbers) + pairs])
        bounds.append((pairs, highest, with_time))

    def proven(until: Array) -> Mask:
        values, holds = np.append(numbers, until), np.zeros(len(ends), dtype=bool)
        for pairs, highest, variables in bounds:
            holds[pairs] = highest(values, variables)[:, 0] <= 0.0
        return holds

    return proven


class CertifiedStart(NamedTuple):
    """Certificates at x(0)."""

    safe: bool
    """True if every pair's h <= 0 at x(0)."""
    refused: dict[str, str]
    """Reasons, by label, of pairs that no input can certify."""
    agents: dict[str, bool]
    """By normal agent: True if an input was found at x(0) with which all its pairs are proven safe
    until another may replace it at the earliest: less does not do in any run."""

    @property
    def holds(self) -> bool:
        """True if certificates can cover every pair from the start of a run."""
        return self.safe and not self.refused and all(self.agents.values())


def certified_start(swarm: Swarm) -> CertifiedStart:
    """Evaluate the certificates of the verdict at x(0)."""
    certificates = SwarmCertificates(swarm)
    agents = {i: certificates.of(i) for i in swarm.normal}
    composed, x = swarm.safe_set, swarm.start()
    refused, reasons = {}, {i: proofs.refused for i, proofs in agents.items()}
    for number, pair in enumerate(composed.pairs):
        sides = [reasons[l] for l in (pair.a, pair.b) if l in agents]
        if all(number in side for side in sides):
            refused[composed.label(pair)] = sides[0][number]
    begun = {}
    for i in agents:
        clock = swarm.groups[i].clock
        until_next = swarm.time.latency or clock.period - clock.jitter
        begun[swarm.names[i]] = longest_certificate(swarm, i, x) >= until_next
    h = swarm.pairs.choose(swarm.pairs.every).h(x)
    return CertifiedStart(bool((h <= 0.0).all()), refused, begun)


def longest_certificate(swarm: Swarm, i: int, x: Array) -> float:
    """Return the longest certificate of all of normal agent i's pairs by a first input at x [s].

    The inputs are zero and the corners of U_i; with a latency, zero alone, which is held at first.
    Pairs for which no certificate exists do not count.
    """
    certificates, dynamics = SwarmCertificates(swarm).of(i), swarm.members[i].dynamics
    inputs = [np.zeros(len(dynamics.inputs))]
    if not swarm.time.latency:
        state = ca.SX.sym("x", len(dynamics.states))
        polytope = constant_polytope(*dynamics.input_polytope(state))
        inputs += [] if polytope is None else list(polytope.corners)
    certified = [certificates(x, u)[certificates.provable] for u in inputs]
    return max(float(times.min(initial=certificates.longest)) for times in certified)
