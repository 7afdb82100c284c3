"""The builder of an agent's rows: chains, margins, polytopes and filters.

Agents, the check before a run, reports and proofs all use it, so that the rows checked are the rows
applied.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import casadi as ca
import numpy as np

from phalanx.scenario.model import ScenarioError
from phalanx.swarm.swarm import Swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import added
from phalanx.theory.margins.margin import AgentMargin, RowPart
from phalanx.theory.models.polytope import EmptyPolytopeError
from phalanx.theory.rows.composed import ComposedTerms, SwarmTerms
from phalanx.theory.rows.pairs import OwnPair, OwnPairTerms, PairRowFunction
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.safety_filter import (
    ComposedFilter,
    PairwiseFilter,
    SafetyFilter,
    Unfiltered,
)
from phalanx.theory.safety.chain import Chain, build_chain
from phalanx.theory.safety.composition import ComposedSet
from phalanx.theory.safety.pairs import PairFunctions


@dataclass(frozen=True)
class SafetyRows:
    """The rows of a swarm."""

    swarm: Swarm
    composed: SwarmTerms
    """h_tot from its pairs."""
    _views: "dict[int, SafetyRows]" = field(default_factory=dict, compare=False)
    """Rows of the swarm as agents know it that read no role."""

    @cached_property
    def chain(self) -> Chain:
        """Chain of h_tot as one expression of all states, which grows with the swarm's square.

        Used for bounds over a box, the constants of the paper's formula. Values at a state are
        computed from pairs instead.
        """
        return _chain(self.swarm, self.swarm.safe_set)

    def seen_by(self, i: int) -> "SafetyRows":
        """Return the rows of the swarm as agent i knows it; these, where roles are declared.

        Adversaries know everything. Rows with equal expressions are compiled once for all agents.
        """
        swarm = self.swarm
        if swarm.safety.information_model.reads_roles or swarm.members[i].adversary:
            return self
        if i not in self._views:
            self._views[i] = build_rows(swarm.seen_by(i))
        return self._views[i]

    @property
    def relative_degree(self) -> int:
        """q."""
        return self.swarm.pairs.degree

    def filter(self, i: int) -> SafetyFilter:
        """Return the safety filter of agent i under distributed control."""
        swarm, safety = self.swarm, self.swarm.safety
        if swarm.members[i].adversary:
            return self.unfiltered(i)
        information = swarm.information()
        if not safety.pairwise:
            return ComposedFilter(i, information, self.qp(i), swarm.pairs)
        return PairwiseFilter(i, information, self.qp(i), self.pair_terms(i))

    def unfiltered(self, i: int) -> SafetyFilter:
        """Return the filter of an adversary, or of a normal agent that turned into one."""
        return Unfiltered(i, self.qp(i))

    def terms(self, i: int) -> ComposedTerms:
        """Return the terms of h_tot of what agent i sees, with the margin of its row if any."""
        swarm, radius = self.swarm, self.swarm.sensing(i)
        if swarm.members[i].adversary or swarm.safety.pairwise:
            return self.composed.of(i, radius)
        return self.composed.of(i, radius, self.margin(i).eta)

    def terms_of_all(self, margin: float) -> ComposedTerms:
        """Return the terms of h_tot of all pairs, as printed, with this margin."""
        return self.composed.of(self.swarm.normal[0], None, margin)

    def own_pair(self, i: int, other: int, plain: bool) -> OwnPair:
        """Return the pair of normal agent i and another member, or N + k for obstacle k.

        Pairs of members of the same two groups have the same expressions.
        plain: as for plain_pairs.
        """
        pairs = self.swarm.pairs
        a, b = pairs.ordered(i, other)
        return OwnPair(_chain(self.swarm, pairs.alone(a, b), plain), 0 if a == i else 1)

    def pair_terms(self, i: int) -> OwnPairTerms:
        """Return the terms of agent i's pairs, with their margins."""
        return self._pair_terms(i, self.margin(i))

    def pair_terms_of_gap(self, i: int) -> OwnPairTerms:
        """Return pair_terms as a function of the time for which an input may be in force [s]."""
        gap = ca.SX.sym("gap")
        return self._pair_terms(i, replace(self.margin(i), horizon=gap, symbols=(gap,)))

    def plain_pairs(self, i: int) -> OwnPairTerms:
        """Return the terms of agent i's pairs as printed for continuous time: no margin, ξ or D_k.

        Disturbances and the time between samples have no place in them.
        """
        return self._pair_terms(i, None)

    def _pair_terms(self, i: int, margin: AgentMargin | None) -> OwnPairTerms:
        swarm, radius = self.swarm, self.swarm.sensing(i)
        near = self.composed.obstacles_within(i, radius)
        row = partial(self.row_function, i, margin)
        return OwnPairTerms(swarm.pairs, i, row, near)

    def row_function(
        self, i: int, margin: AgentMargin | None, other: int, part: RowPart
    ) -> PairRowFunction:
        """Return agent i's row for own_pair(i, other), compiled once for equal expressions.

        Without margin it is plain.
        """
        symbols = () if margin is None else margin.symbols
        swarm, (a, b) = self.swarm, self.swarm.pairs.ordered(i, other)
        groups = [swarm.group_numbers[l] for l in (i, other) if l < len(swarm.members)]
        # Rows with equal expressions have these in common. To build the row and compare it would
        # take as long as to compile it: its margin is an interval extension.
        text, plain = swarm.pairs.kind_of(a, b).text, margin is None
        key = "row", text, a == i, *groups, part, plain, str(symbols)

        def compiled() -> PairRowFunction:
            pair = self.own_pair(i, other, plain)
            eta = ca.SX(0) if margin is None else margin.of(pair.chain, pair.side, part)
            return PairRowFunction(pair, part, eta, symbols)

        return swarm.functions.get(key, compiled)

    def pair_chain(self, pair: int) -> Chain:
        """Return the chain of one pair alone, by its index in the safe set."""
        return _chain(self.swarm, self.swarm.safe_set.alone(pair))

    @cached_property
    def pair_psi(self) -> PairFunctions:
        """ψ_0 ... ψ_{q-1} of pairs alone."""
        swarm = self.swarm
        return PairFunctions(swarm.pairs, list(swarm.group_numbers), self._psi)

    def _psi(self, pair: ComposedSet, kind: int) -> MappedFunction:
        swarm = self.swarm
        groups = [swarm.group_numbers[swarm.names.index(m.name)] for m in pair.members]
        key, row = ("psi", swarm.pairs.kinds[kind].text, *groups), [pair.x, pair.parameters]
        return swarm.functions.get(key, lambda: MappedFunction(row, list(_chain(swarm, pair).psi)))

    def margin(self, i: int) -> AgentMargin:
        """Return the scenario's choice of agent i's margins."""
        safety = self.swarm.safety
        return AgentMargin(
            kind=safety.margin_kind,
            eta=self._eta(i),
            horizon=self.swarm.horizon(i),
            bounds=self.swarm.disturbance_bounds,
        )

    def invariants(self, of_all: bool = False) -> Callable[[Array], Array]:
        """Return x -> all ψ_0 ... ψ_{q-1}, which are <= 0 in S_I, as the scenario composes them.

        of_all: of all pairs together, whichever agents see them, as *stayed in S_I* has it.
        """
        swarm, safety = self.swarm, self.swarm.safety
        if safety.pairwise:
            psi = self.pair_psi.choose(swarm.pairs.every)
            return lambda x: psi(x).ravel()
        if of_all or (safety.information_model.reads_roles and not swarm.limited):
            return self.terms_of_all(0.0).psi
        # With limited sensing, or its own pairs alone, every agent composes its own set.
        views = [(i, self.seen_by(i).composed.of(i, swarm.sensing(i))) for i in swarm.normal]
        return lambda x: np.concatenate([terms.psi(x, swarm.seen(i, x)) for i, terms in views])

    def _eta(self, i: int) -> float:
        """Return η(Γ_i + δ^max) of agent i, given or from constants."""
        groups = self.swarm.groups
        longest = groups[i].clock.period + max(group.clock.jitter for group in groups)
        disturbances = added(group.disturbance.bound for group in groups)
        # For q > 1 Eq. (etaprimedef) has no disturbance term; `corrected` adds D_q at each state.
        counted = disturbances if self.relative_degree == 1 else 0.0
        return self.swarm.safety.eta_at(longest, counted)

    def qp(self, i: int) -> NearestInput:
        """Return a solver of agent i's QP."""
        return NearestInput(self.swarm.members[i].dynamics.input_metric())


def build_rows(swarm: Swarm) -> SafetyRows:
    """Build a swarm's rows. Raises ScenarioError if an input polytope is empty or unbounded."""
    safety = swarm.safety
    xi = safety.xi_of_chain or 0.0
    try:
        return SafetyRows(swarm, SwarmTerms(swarm.pairs, safety.rho, safety.class_k, xi))
    except (ValueError, EmptyPolytopeError) as error:
        raise ScenarioError(f"{swarm.scenario.name}: {error}") from error


def _chain(swarm: Swarm, composed: ComposedSet, plain: bool = False) -> Chain:
    """Build a chain with the disturbance terms of the scenario's margin; none if it is plain."""
    safety = swarm.safety
    if plain:
        return build_chain(composed, safety.class_k)
    bounds = [swarm.disturbance_bounds[m.name] for m in composed.members]
    counted = bounds if safety.counts_disturbance else None
    return build_chain(composed, safety.class_k, safety.xi_of_chain, counted)
