"""The builder of an agent's rows: chains, margins, polytopes and filters, each assembled here once.

Agents, the check before a run, reports and proofs all build from it, so that what is checked is
what is run.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca

from phalanx.scenario.load import ScenarioError
from phalanx.swarm.swarm import Swarm
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import added
from phalanx.theory.margins.margin import Margin
from phalanx.theory.margins.paper import MarginConstants
from phalanx.theory.margins.row_part import RowPart
from phalanx.theory.models.polytope import EmptyPolytopeError
from phalanx.theory.rows.pairs import OwnPair, PairTermsFunction, own_pairs
from phalanx.theory.rows.qp import NearestInput
from phalanx.theory.rows.safety_filter import (
    ComposedFilter,
    PairwiseFilter,
    SafetyFilter,
    Unfiltered,
)
from phalanx.theory.rows.terms import TermsFunction
from phalanx.theory.safety.chain import Chain, build_chain
from phalanx.theory.safety.composition import ComposedSet


@dataclass(frozen=True)
class SafetyRows:
    """What every row of a swarm is made of."""

    swarm: Swarm
    chain: Chain
    """Of h_tot, all pairs composed."""
    pair_chains: Mapping[int, Chain]
    """Of each pair by its index, where the scenario keeps one row for each pair; else empty."""

    def filter(self, i: int) -> SafetyFilter:
        """What the scenario asks of agent i on its own."""
        swarm, safety = self.swarm, self.swarm.scenario.safety
        if swarm.members[i].adversary:
            return self.unfiltered(i)
        information = swarm.information()
        if not self.pair_chains:
            return ComposedFilter(i, information, self._qp(i), safety.authority)
        pairs = self.own_pairs(i)
        return PairwiseFilter(i, information, self._qp(i), pairs, self.pair_terms(i))

    def unfiltered(self, i: int) -> SafetyFilter:
        """An adversary's, or a normal agent's that turned into one."""
        return Unfiltered(i, self._qp(i))

    def terms(self, i: int) -> TermsFunction:
        """Agent i's compiled h_tot, its margin included; an adversary sees everything."""
        if self.swarm.members[i].adversary or self.pair_chains:
            return TermsFunction(self.chain)
        active = self._active(i)
        return TermsFunction(self.chain, active, self.margin(i).of(self.chain, i, active=active))

    def own_pairs(self, i: int) -> list[OwnPair]:
        """The pairs that normal agent i keeps a row for."""
        return own_pairs(self.swarm.safe_set, self.pair_chains, i)

    def pair_terms(self, i: int) -> PairTermsFunction:
        """Agent i's compiled pairs, their margins included."""
        return self.pair_terms_with(i, self.margin(i))

    def pair_terms_with(self, i: int, margin: Margin) -> PairTermsFunction:
        """The same with another margin; a symbol for its horizon is a second argument."""
        pairs = self.own_pairs(i)
        margins = [
            (
                margin.of(p.chain, p.own),
                margin.of(p.chain, p.own, RowPart.HALF) if p.shared else ca.SX(0),
            )
            for p in pairs
        ]
        return PairTermsFunction(
            self.swarm.safe_set, pairs, margins, self._active(i), margin.symbols
        )

    def pair_chain(self, pair: int) -> Chain:
        """The chain of one pair of h_tot alone, by the pair's index."""
        return _chain(self.swarm, self.swarm.safe_set.alone(pair))

    def margin(self, i: int) -> Margin:
        """How agent i's margins are made."""
        safety = self.swarm.scenario.safety
        return Margin(
            kind=safety.margin,
            eta=self._eta(i),
            scale=safety.margin_scale,
            horizon=self.swarm.horizon(i),
            bounds=self.swarm.disturbance_bounds,
        )

    def invariants(self) -> CompiledFunction:
        """x -> all ψ_0 ... ψ_{q-1} that are not above 0 in S_I, as this scenario composes them."""
        composed = self.swarm.safe_set
        if self.pair_chains:
            values = [psi for chain in self.pair_chains.values() for psi in chain.psi]
        else:
            # With limited sensing every agent composes a set of its own.
            views = self.swarm.normal if self.swarm.limited else self.swarm.normal[:1]
            values = [
                composed.substitute(psi, self._active(i)) for i in views for psi in self.chain.psi
            ]
        return CompiledFunction([composed.x], [ca.vertcat(*values)])

    def _eta(self, i: int) -> float:
        """η(Γ_i + δ^max) of agent i, given or from constants."""
        eta = self.swarm.scenario.safety.eta
        if not isinstance(eta, MarginConstants):
            return eta
        groups = self.swarm.groups
        longest = groups[i].clock.period + max(group.clock.jitter for group in groups)
        disturbances = added(group.disturbance.bound for group in groups)
        # For q > 1 Eq. (etaprimedef) has no term of theirs; corrected, D_q is added at each state.
        return eta.eta(longest, disturbances if self.chain.relative_degree == 1 else 0.0)

    def _active(self, i: int) -> ca.SX | None:
        """Which pairs agent i composes, shape (p,), 0 or 1; None for all."""
        radius = self.swarm.sensing(i)
        return None if radius is None else self.swarm.safe_set.within(i, radius)

    def _qp(self, i: int) -> NearestInput:
        return NearestInput(self.swarm.members[i].dynamics.input_metric())


def build_rows(swarm: Swarm) -> SafetyRows:
    """Differentiate a swarm's safe set.

    Raises:
        ScenarioError: mixed relative degree, wrong number of gains, or a user's expression that
            cannot be differentiated.
    """
    scenario, composed = swarm.scenario, swarm.safe_set
    try:
        pairs = range(len(composed.pairs)) if scenario.safety.composition == "pairs" else ()
        pair_chains = {p: _chain(swarm, composed.alone(p)) for p in pairs}
        return SafetyRows(swarm, _chain(swarm, composed), pair_chains)
    except (ValueError, EmptyPolytopeError) as error:
        raise ScenarioError(f"{scenario.name}: {error}") from error
    except Exception as error:  # CasADi, on expressions of a user's own
        reason = str(error).strip().splitlines()[-1]
        raise ScenarioError(f"{scenario.name}: the safe set cannot be built: {reason}") from error


def require_runnable(swarm: Swarm) -> None:
    """Build the rows of the first normal agent, as its process will.

    Raises:
        ScenarioError: the scenario's margin or composition cannot take its expressions.
    """
    rows, i = build_rows(swarm), swarm.normal[0]
    try:
        rows.terms(i)
        rows.filter(i)
    except ValueError as error:
        raise ScenarioError(f"{swarm.scenario.name}: safety: {error}") from error


def _chain(swarm: Swarm, composed: ComposedSet) -> Chain:
    """The chain with the disturbance terms that the scenario's margin asks for."""
    safety = swarm.scenario.safety
    if safety.margin == "paper":
        return build_chain(composed, safety.class_k(), safety.xi)
    bounds = [swarm.disturbance_bounds[m.name] for m in composed.members]
    xi = None if safety.computes_margin else safety.xi
    return build_chain(composed, safety.class_k(), xi, bounds)
