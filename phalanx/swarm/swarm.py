"""A scenario's facts, resolved: who takes part, with what, from where, on which clock."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import casadi as ca
import numpy as np

from phalanx.arrays import Array
from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.declared import Links
from phalanx.scenario.load import ScenarioError, digest
from phalanx.scenario.model import Scenario, Time
from phalanx.scenario.safety import Safety
from phalanx.seeded.clock import SamplingClock
from phalanx.seeded.draws import Draws
from phalanx.theory.expressions.asked import MistakenMethodError, ask
from phalanx.theory.expressions.compiled import CompiledFunction
from phalanx.theory.expressions.exact import added, dot
from phalanx.theory.laws.formation import Goal, hold
from phalanx.theory.laws.law import Law, TeamLaw
from phalanx.theory.models.polytope import EmptyPolytopeError
from phalanx.theory.rows.information import InformationModel
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.pairs import SwarmPairs


class Speaker(NamedTuple):
    """What everybody knows beforehand of a normal agent's broadcasts."""

    i: int
    """Whose they are."""
    inputs: int
    """m_i"""
    most: int
    """More of them than it can send in the run."""


@dataclass(frozen=True)
class Swarm:
    """A scenario and its safe set: what plant, agents and viewers all build, each for itself."""

    scenario: Scenario
    safe_set: ComposedSet
    """All pairs, composed."""
    pairs: SwarmPairs
    """The same pairs, to be evaluated kind by kind."""

    @property
    def safety(self) -> Safety:
        """The choices of the controller."""
        return self.scenario.safety

    @property
    def time(self) -> Time:
        """The clock of the run."""
        return self.scenario.time

    @property
    def seed(self) -> int:
        """Of everything random."""
        return self.scenario.seed

    @property
    def members(self) -> tuple[Member, ...]:
        """Every agent, in the scenario's order."""
        return self.safe_set.members

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Every agent's name."""
        return tuple(m.name for m in self.members)

    @cached_property
    def normal(self) -> tuple[int, ...]:
        """Indices of the normal agents."""
        return tuple(i for i, m in enumerate(self.members) if not m.adversary)

    @cached_property
    def groups(self) -> tuple[AgentGroup, ...]:
        """Every agent's group."""
        return tuple(group for _, group, _ in self.scenario.roster())

    @cached_property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """The first and the last of each group: they have every place in every kind of pair."""
        members: dict[int, list[int]] = {}
        for l, group in enumerate(self.groups):
            members.setdefault(id(group), []).append(l)
        return tuple((each[0], each[-1]) for each in members.values())

    def sensing(self, i: int) -> float | None:
        """How far agent i sees [m]; None if it sees everything."""
        safety, own = self.safety, self.groups[i].sensing
        if self.members[i].adversary:
            return own
        return None if safety.needs_all_states else own or safety.neighbourhood

    @cached_property
    def programs(self) -> Mapping[str, tuple[str, ...]]:
        """As phalanx.scenario.model.Scenario.programs."""
        return self.scenario.programs()

    @cached_property
    def digest(self) -> str:
        """Of the scenario: who has another one cannot take part."""
        return digest(self.scenario)

    @cached_property
    def links(self) -> Links:
        """What goes wrong on links and with agents."""
        return self.scenario.links()

    @cached_property
    def limited(self) -> bool:
        """Whether some normal agent sees, and so composes, less than everything."""
        return any(self.sensing(i) is not None for i in self.normal)

    def seen(self, i: int, x: Array) -> tuple[int, ...]:
        """Whom agent i sees at the stacked state x, shape (n̄,), itself included."""
        radius = self.sensing(i)
        if radius is None:
            return tuple(range(len(self.members)))
        points = self.positions(x)
        apart = points - points[i]
        return tuple(np.flatnonzero(dot(apart, apart) <= radius * radius).tolist())

    def position(self, i: int) -> CompiledFunction:
        """Agent i's output position [m] from its state, compiled once for equal dynamics."""
        dynamics = self.members[i].dynamics
        if id(dynamics) not in self._position:
            x = ca.SX.sym("x", len(dynamics.states))
            self._position[id(dynamics)] = CompiledFunction([x], [dynamics.position(x)])
        return self._position[id(dynamics)]

    @cached_property
    def _position(self) -> dict[int, CompiledFunction]:
        return {}

    def positions(self, x: Array) -> Array:
        """Output positions [m] at the stacked state x, shape (N, 2) or (N, 3)."""
        return self._positions(x)[0].reshape(len(self.members), -1)

    @cached_property
    def _positions(self) -> CompiledFunction:
        composed = self.safe_set
        return CompiledFunction([composed.x], [ca.horzcat(*composed.positions).T])

    def apart(self, x: Array, i: int, j: int) -> float:
        """From agent i's output point to agent j's in the stacked state x, shape (n̄,) [m]."""
        parts = self.safe_set.parts
        own, other = (self.position(a)(x[parts[a]])[0] for a in (i, j))
        steps = zip(own.tolist(), other.tolist(), strict=True)
        return math.sqrt(added((p - q) * (p - q) for p, q in steps))

    def heard_by(self, i: int) -> tuple[int, ...]:
        """The agents whose broadcasts count for agent i, wherever they are."""
        if self.members[i].adversary or self.safety.centralised:
            return ()
        return tuple(j for j in self.normal if j != i)

    @cached_property
    def speakers(self) -> dict[str, Speaker]:
        """Every normal agent by name."""
        return {
            self.names[i]: Speaker(
                i,
                len(self.members[i].dynamics.inputs),
                self.clock(i).most_samples(self.scenario.duration),
            )
            for i in self.normal
        }

    @property
    def synchronous(self) -> bool:
        """Whether all normal agents sample at the same instants, as Theorem 1 has it."""
        clocks = [self.groups[l].clock for l in self.normal]
        return all(c.jitter == 0.0 and c.period == clocks[0].period for c in clocks)

    @cached_property
    def disturbance_bounds(self) -> dict[str, float]:
        """φ_l^max of every agent by name."""
        return {
            name: group.disturbance.bound
            for name, group in zip(self.names, self.groups, strict=True)
        }

    def clock(self, i: int) -> SamplingClock:
        """Agent i's perturbed sampling clock."""
        clock = self.groups[i].clock
        return SamplingClock(self.seed, self.names[i], clock.period, clock.jitter)

    def horizon(self, i: int) -> float:
        """How long after a sample of agent i its input may still be in force [s]."""
        clock = self.groups[i].clock
        return clock.period + clock.jitter + self.time.latency

    def information(self) -> InformationModel:
        """Which received inputs a row may count on."""
        safety = self.safety
        clocks = {l: self.groups[l].clock for l in self.normal}
        unchanged = {l: clock.period - clock.jitter for l, clock in clocks.items()}
        return InformationModel(safety.information, unchanged, safety.silence)

    def law(self, i: int) -> Law:
        """A law for agent i that has not been asked yet.

        Raises ScenarioError if it does not fit the swarm.
        """
        law = self.groups[i].law_object()
        if not isinstance(law, TeamLaw):
            return law
        try:
            joined = ask(law, "join", "a law", i, self.members, self.scenario.obstacles)
        except MistakenMethodError as error:
            reason = error.__cause__ if isinstance(error.__cause__, ValueError) else error
            raise ScenarioError(
                f"{self.scenario.name}: law of {self.names[i]}: {reason}"
            ) from error
        return cast(Law, joined)

    def goal(self, i: int) -> Callable[[float, Array], Goal]:
        """Where agent i wants to be, given t [s] and its state, shape (n_i,).

        In its formation slot, or where its flow takes it; without either, here.
        """
        slot, formation, flows = self._slot(i), self.scenario.formation, self.scenario.flows
        if slot is not None and formation:
            return lambda t, _: formation.goal(slot, t)
        if flows:
            start = np.array(self.groups[i].start[self._place(i)][: self.groups[i].axes])
            return lambda t, _: flows.goal(i, start, t)
        position = self.position(i)
        return lambda _, x: hold(position(x)[0])

    def start(self) -> Array:
        """x(0), shape (n̄,): each agent's start plus its spread, drawn by (seed, name)."""
        return np.concatenate([self._start(i) for i in range(len(self.members))])

    def _start(self, i: int) -> Array:
        group = self.groups[i]
        x = np.zeros(len(self.members[i].dynamics.states))
        if group.start:
            x[:] = group.start[self._place(i)]
        else:
            goal = self.goal(i)(0.0, x)
            x[: len(goal.position)] = goal.position
        if group.spread:
            draw = Draws(self.seed, "start", self.names[i], width=len(x))[0]
            x += np.array(group.spread) * (2.0 * draw - 1.0)
        return x

    def _place(self, i: int) -> int:
        """Agent i's place in its group."""
        return self.groups[i].names.index(self.names[i])

    def _slot(self, i: int) -> int | None:
        slots = self.groups[i].slots
        return slots[self._place(i)] if slots else None


def build_swarm(scenario: Scenario) -> Swarm:
    """Compose the scenario's safe set.

    Raises:
        ScenarioError: positions that do not fit together, mixed relative degree, a wrong number of
            gains, or a user's expression that fails.
    """
    safety = scenario.safety
    members = [
        Member(name, group.dynamics_object(), group.role == "adversary")
        for name, group, _ in scenario.roster()
    ]
    try:
        function = safety.safe_set_function
        composed = compose(members, scenario.static, function, safety.rho)
        pairs = SwarmPairs(composed.members, composed.obstacles, function, len(safety.alpha))
    except (ValueError, EmptyPolytopeError) as error:
        raise ScenarioError(f"{scenario.name}: {error}") from error
    except Exception as error:  # CasADi, on expressions of a user's own
        reason = str(error).strip().splitlines()[-1]
        raise ScenarioError(f"{scenario.name}: the safe set cannot be built: {reason}") from error
    return Swarm(scenario, composed, pairs)


def unit_of_psi(scenario: Scenario, k: int = 0) -> str:
    """That of ψ_k: of h for each second to the power k, such as "m²/s²"; "" if h's is unknown.

    A function says it as its attribute `unit`. Pairs and limits may differ in it.
    """
    limits = [limit.boundary.limit for limit in scenario.limits]
    functions = [scenario.safety.safe_set_function, *limits]
    found = {getattr(function, "unit", "") for function in functions}
    of_h = str(found.pop()) if len(found) == 1 else ""
    if not of_h or k == 0:
        return of_h
    return f"{of_h}/s{'' if k == 1 else str(k).translate(_SUPERSCRIPT)}"


_SUPERSCRIPT = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
