"""A scenario's theory objects: members, chain, starts, goals, margins."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.load import ScenarioError
from phalanx.scenario.model import Scenario
from phalanx.seeded.clock import SamplingClock
from phalanx.seeded.draws import Draws
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.laws.formation import Goal, hold
from phalanx.theory.laws.law import Law, TeamLaw
from phalanx.theory.margins.local import local_margin
from phalanx.theory.margins.paper import MarginConstants
from phalanx.theory.models.polytope import EmptyPolytopeError
from phalanx.theory.rows.information import Information, InformationModel
from phalanx.theory.rows.pairs import HALF, OwnPair, PairTermsFunction, own_pairs
from phalanx.theory.rows.terms import TermsFunction
from phalanx.theory.safety.chain import Chain, build_chain
from phalanx.theory.safety.composition import ComposedSet, Member, compose

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Swarm:
    """A scenario resolved: what plant and agents both build, each for itself."""

    scenario: Scenario
    chain: Chain
    """Of h_tot, all pairs composed."""
    pair_chains: Mapping[int, Chain]
    """Of each pair by its index, where the scenario keeps one row for each pair; else empty."""

    @cached_property
    def members(self) -> tuple[Member, ...]:
        """Every agent, in the scenario's order."""
        return self.chain.set.members

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Every agent's name."""
        return tuple(m.name for m in self.members)

    @cached_property
    def normal(self) -> tuple[int, ...]:
        """Indices of the normal agents."""
        return tuple(i for i, m in enumerate(self.members) if not m.adversary)

    @property
    def radius(self) -> float | None:
        """Of the neighbourhood [m]; None if everything is composed, as one controller does."""
        safety = self.scenario.safety
        return safety.neighbourhood if safety.control == "distributed" else None

    @property
    def joint(self) -> bool:
        """Whether normal agents count on one another's best effort: by shares, or by one mind."""
        safety = self.scenario.safety
        return safety.control == "centralised" or safety.information is Information.SPLIT

    @property
    def synchronous(self) -> bool:
        """Whether all normal agents sample at the same instants, as Theorem 1 has it."""
        clocks = [self.group(l)[0].clock for l in self.normal]
        return all(c.jitter == 0.0 and c.period == clocks[0].period for c in clocks)

    def active(self, i: int) -> ca.SX | None:
        """Which pairs agent i composes, shape (p,), 0 or 1; None for all."""
        radius = self.radius
        return None if radius is None else self.chain.set.within(i, radius)

    def law(self, i: int) -> Law:
        """Agent i's law. Raises ScenarioError if it does not fit the swarm."""
        law = self.group(i)[0].law_object()
        if not isinstance(law, TeamLaw):
            return law
        try:
            return law.join(i, self.members, self.chain.set.obstacles)
        except ValueError as error:
            raise ScenarioError(f"{self.scenario.name}: law of {self.names[i]}: {error}") from error

    def group(self, i: int) -> tuple[AgentGroup, int]:
        """Agent i's group and its place there."""
        _, group, place = list(self.scenario.roster())[i]
        return group, place

    def clock(self, i: int) -> SamplingClock:
        """Agent i's perturbed sampling clock."""
        clock = self.group(i)[0].clock
        return SamplingClock(self.scenario.seed, self.names[i], clock.period, clock.jitter)

    def horizon(self, i: int) -> float:
        """How long after a sample of agent i its input may still be in force [s]."""
        clock = self.group(i)[0].clock
        return clock.period + clock.jitter + self.scenario.time.latency

    def trust(self) -> InformationModel:
        """Which received inputs a row may count on."""
        safety = self.scenario.safety
        clocks = {l: self.group(l)[0].clock for l in self.normal}
        unchanged = {l: clock.period - clock.jitter for l, clock in clocks.items()}
        return InformationModel(safety.information, unchanged, safety.silence)

    def terms(self, i: int) -> TermsFunction:
        """Agent i's own compiled h_tot; an adversary sees everything."""
        if self.members[i].adversary or self.pair_chains:
            return TermsFunction(self.chain)
        active = self.active(i)
        return TermsFunction(self.chain, active, self._margin(self.chain, i, None, active))

    def pair_chain(self, pair: int) -> Chain:
        """The chain of one pair of h_tot alone, by the pair's index."""
        return _chain(self.scenario, self.chain.set.alone(pair))

    def own_pairs(self, i: int) -> list[OwnPair]:
        """The pairs that normal agent i keeps a row for."""
        return own_pairs(self.chain.set, self.pair_chains, i)

    def pair_terms(self, i: int) -> PairTermsFunction:
        """Agent i's compiled pairs."""
        pairs = self.own_pairs(i)
        whole = [self._margin(p.chain, p.own, None) for p in pairs]
        halves = [self._margin(p.chain, p.own, HALF) if p.shared else 0.0 for p in pairs]
        margins = list(zip(whole, halves, strict=True))
        return PairTermsFunction(self.chain.set, pairs, margins, self.active(i))

    def margin_of(self, chain: Chain) -> ca.SX | float:
        """The state-dependent part of the margin of the first member's whole row."""
        return self._margin(chain, 0, None)

    def _margin(
        self, chain: Chain, own: int, share: float | None, active: ca.SX | None = None
    ) -> ca.SX | float:
        """The state-dependent part of the margin of one member's row."""
        if self.scenario.safety.margin == "local":
            horizon = self.horizon(self.names.index(chain.set.members[own].name))
            return self.local_margin(chain, own, share, horizon, active)
        if chain.relative_degree == 1:
            return 0.0  # what the disturbance adds to h's rate is in η already
        return chain.disturbance * (1.0 if share is None else share)

    def local_margin(
        self,
        chain: Chain,
        own: int,
        share: float | None,
        horizon: float | ca.SX,
        active: ca.SX | None = None,
    ) -> ca.SX:
        """The local margin of one member's row until `horizon` after its sample [s]."""
        places = [self.names.index(m.name) for m in chain.set.members]
        bounds = [self.group(l)[0].disturbance.bound for l in places]
        return local_margin(chain, own, horizon, bounds, share, active)

    def invariants(self) -> CompiledFunction:
        """x -> all ψ_0 ... ψ_{q-1} that are not above 0 in S_I, as this scenario composes them."""
        composed = self.chain.set
        if self.pair_chains:
            values = [psi for chain in self.pair_chains.values() for psi in chain.psi]
        else:
            views = self.normal if self.radius else self.normal[:1]
            values = [
                composed.substitute(psi, self.active(i)) for i in views for psi in self.chain.psi
            ]
        return CompiledFunction([composed.x], [ca.vertcat(*values)])

    def gaps_in_the_proof(self) -> list[str]:
        """Why the margin and the rows, as this scenario has them, prove nothing; empty if they do.

        What a run can check, such as the sampling gap and the age of û, is not among these.
        """
        safety = self.scenario.safety
        gaps = {
            "η is given or from given constants, not a bound": safety.margin != "local",
            "the margin is scaled down": safety.margin_scale < 1.0,
            "shares of h_tot computed from different samples are not bounded: use pairs": (
                safety.control == "distributed"
                and safety.composition == "lse"
                and safety.information is Information.SPLIT
            ),
            "h_tot^i changes as pairs enter and leave the neighbourhood": (self.radius is not None),
            "Theorem 1 needs agents that sample together, with one period and no jitter": (
                safety.control == "centralised" and not self.synchronous
            ),
            "no certified input is in force before the latency is over": (
                self.scenario.time.latency > 0.0
            ),
        }
        return [gap for gap, open_ in gaps.items() if open_]

    def eta(self, i: int) -> float:
        """η(Γ_i + δ^max) of agent i, given or from constants."""
        eta = self.scenario.safety.eta
        if not isinstance(eta, MarginConstants):
            return eta
        groups = [group for _, group, _ in self.scenario.roster()]
        longest = groups[i].clock.period + max(group.clock.jitter for group in groups)
        disturbances = sum(group.disturbance.bound for group in groups)
        # For q > 1 Eq. (etaprimedef) has no term of theirs; corrected, D_q is added at each state.
        return eta.eta(longest, disturbances if self.chain.relative_degree == 1 else 0.0)

    def start(self) -> Array:
        """x(0), shape (n̄,): each agent's start plus its spread, drawn by (seed, name)."""
        return np.concatenate([self._start(i) for i in range(len(self.members))])

    def _start(self, i: int) -> Array:
        group, place = self.group(i)
        dynamics = self.members[i].dynamics
        x = np.zeros(len(dynamics.states))
        if group.start:
            x[:] = group.start[place]
        else:
            goal = self.goal_of(i)(0.0, x)
            x[: len(goal.position)] = goal.position
        if group.spread:
            draw = Draws(self.scenario.seed, "start", self.names[i], width=len(x))[0]
            x += np.array(group.spread) * (2.0 * draw - 1.0)
        return x

    def goal_of(self, i: int) -> Callable[[float, Array], Goal]:
        """Where agent i wants to be, given t [s] and where it is: its formation slot, or here."""
        group, place = self.group(i)
        formation = self.scenario.formation
        if group.slots and formation:
            slot = group.slots[place]
            return lambda t, _: formation.goal(slot, t)
        return lambda _, position: hold(position)


def build_swarm(scenario: Scenario) -> Swarm:
    """Differentiate the scenario's safe set.

    Raises:
        ScenarioError: mixed relative degree, wrong number of gains, positions that do not fit
            together, or a user's expression that fails.
    """
    safety = scenario.safety
    members = [
        Member(name, group.dynamics_object(), group.role == "adversary")
        for name, group, _ in scenario.roster()
    ]
    try:
        composed = compose(members, scenario.obstacles, safety.safe_set_function(), safety.rho)
        chain = _chain(scenario, composed)
        pairs = range(len(composed.pairs)) if safety.composition == "pairs" else ()
        pair_chains = {p: _chain(scenario, composed.alone(p)) for p in pairs}
    except (ValueError, EmptyPolytopeError) as error:
        raise ScenarioError(f"{scenario.name}: {error}") from error
    except Exception as error:  # CasADi, on expressions of a user's own
        reason = str(error).strip().splitlines()[-1]
        raise ScenarioError(f"{scenario.name}: the safe set cannot be built: {reason}") from error
    return Swarm(scenario, chain, pair_chains)


def require_rows(swarm: Swarm) -> None:
    """Build the rows of the first normal agent, as its process will.

    Raises:
        ScenarioError: the scenario's margin or composition cannot take its expressions.
    """
    i = swarm.normal[0]
    try:
        if swarm.pair_chains:
            swarm.pair_terms(i)
        swarm.terms(i)
    except ValueError as error:
        raise ScenarioError(f"{swarm.scenario.name}: safety: {error}") from error


def _chain(scenario: Scenario, composed: ComposedSet) -> Chain:
    """The chain with the disturbance terms that the scenario's margin asks for."""
    safety = scenario.safety
    if safety.margin == "paper":
        return build_chain(composed, safety.class_k(), safety.xi)
    bounds = {name: group.disturbance.bound for name, group, _ in scenario.roster()}
    phi = [bounds[m.name] for m in composed.members]
    xi = None if safety.margin == "local" else safety.xi
    return build_chain(composed, safety.class_k(), xi, phi)
