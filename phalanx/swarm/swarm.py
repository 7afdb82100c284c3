"""A scenario's agents with their dynamics, starts, clocks and safe set."""

import math
from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from phalanx.network.draws import Draws, SamplingClock, Seeds
from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.declared import Links
from phalanx.scenario.model import Scenario, ScenarioError, Time, digest
from phalanx.scenario.safety import Safety
from phalanx.swarm.goals import AgentGoal, Output, motion_function, reference_of
from phalanx.theory.arrays import Array, Index, Mask
from phalanx.theory.expressions.cache import FunctionCache
from phalanx.theory.expressions.compiled import MappedFunction
from phalanx.theory.expressions.exact import added, dot
from phalanx.theory.laws.goals import Stay
from phalanx.theory.laws.law import Law, TeamLaw
from phalanx.theory.models.polytope import EmptyPolytopeError
from phalanx.theory.models.world import moves_by_itself
from phalanx.theory.rows.information import Information
from phalanx.theory.rows.origin import Origin, origins_of_normal
from phalanx.theory.safety.composition import ComposedSet, Member, compose
from phalanx.theory.safety.obstacles import Sphere
from phalanx.theory.safety.pairs import SwarmPairs

DEFECT = 1e-4
"""Bound on the integration error of the plant's motion, as a disturbance [1/s]."""


class Broadcaster(NamedTuple):
    """Properties of a normal agent's broadcasts that are known before the run."""

    i: int
    """Index of the agent."""
    inputs: int
    """m_i"""
    most: int
    """Upper bound on the numbers of its samples in the run."""
    states: int = 0
    """n_i; 0 without a radio, as it then states none."""
    every: int = 1
    """Samples from one broadcast to the next."""
    relays: int = 0
    """Most statements of others in a broadcast."""


@dataclass(frozen=True)
class Swarm:
    """A scenario and its safe set; plant, agents and viewers each build it from the scenario."""

    scenario: Scenario
    safe_set: ComposedSet
    """All pairs, composed."""
    pairs: SwarmPairs
    """The same pairs, evaluated kind by kind."""

    @property
    def safety(self) -> Safety:
        return self.scenario.safety

    @property
    def time(self) -> Time:
        return self.scenario.time

    @property
    def seed(self) -> int:
        return self.scenario.seed

    @property
    def functions(self) -> FunctionCache:
        """Compiled for a key and the compiled_fields alone; the swarm's views share them."""
        return self.pairs.functions

    def seen_by(self, i: int) -> "Swarm":
        """Return the swarm as normal agent i knows it if it reads no role: all others may attack.

        The safe set is then that of agent i's own pairs.
        """
        whole = self.safe_set
        members = [replace(m, adversary=l != i) for l, m in enumerate(whole.members)]
        composed = compose(members, whole.obstacles, whole.function, self.safety.rho)
        gains = self.pairs.degree
        pairs = SwarmPairs(members, whole.obstacles, whole.function, gains, self.functions)
        return Swarm(self.scenario, composed, pairs)

    @property
    def seeds(self) -> Seeds:
        """The seed in force at each time."""
        return self.links.seeds

    @property
    def members(self) -> tuple[Member, ...]:
        """Every agent, in the scenario's order."""
        return self.safe_set.members

    @cached_property
    def names(self) -> tuple[str, ...]:
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
    def group_numbers(self) -> tuple[int, ...]:
        """The index of every agent's group in the scenario."""
        return tuple(g for g, group in enumerate(self.scenario.agents) for _ in group.names)

    @cached_property
    def ends(self) -> tuple[tuple[int, int], ...]:
        """The first and the last agent of each group: together they occur in every kind of pair."""
        members: dict[int, list[int]] = {}
        for l, number in enumerate(self.group_numbers):
            members.setdefault(number, []).append(l)
        return tuple((agents[0], agents[-1]) for agents in members.values())

    def peers(self, i: int) -> tuple[int, ...]:
        """Return the agents that agent i knows by radio: those with a radio, if it has one too."""
        if self.groups[i].radio is None:
            return ()
        return tuple(j for j in self.normal if j != i and self.groups[j].radio is not None)

    @property
    def by_radio(self) -> bool:
        """True if some agents know others by radio."""
        return any(map(self.peers, self.normal))

    def sensing(self, i: int) -> float | None:
        """Return agent i's sensing radius [m]; None if it has no limit."""
        sensor = self.groups[i].sensing
        return sensor if self.members[i].adversary else self.safety.sensing(sensor)

    @cached_property
    def programs(self) -> Mapping[str, tuple[str, ...]]:
        return self.scenario.programs()

    @cached_property
    def digest(self) -> str:
        """Hash of the scenario, which all programs of a run must have in common."""
        return digest(self.scenario)

    @cached_property
    def links(self) -> Links:
        """Link models and faults."""
        return self.scenario.links()

    @cached_property
    def limited(self) -> bool:
        """True if a normal agent's sensing has a limit."""
        return any(self.sensing(i) is not None for i in self.normal)

    def seen(self, i: int, x: Array) -> tuple[int, ...]:
        """Return the agents that agent i sees at the stacked state x, shape (n̄,), with itself."""
        radius = self.sensing(i)
        if radius is None:
            return tuple(range(len(self.members)))
        points = self.positions(x)
        offsets = points - points[i]
        return tuple(np.flatnonzero(dot(offsets, offsets) <= radius * radius).tolist())

    def positions(self, x: Array) -> Array:
        """Return the output positions [m] at one stacked state or several.

        x: shape (..., n̄). Returns shape (..., N, 2) or (..., N, 3).
        """
        points = self._positions.rows(np.atleast_2d(x))
        return points.reshape(*x.shape[:-1], len(self.members), self.groups[0].axes)

    @cached_property
    def _positions(self) -> MappedFunction:
        def compiled() -> MappedFunction:
            composed = self.safe_set
            return MappedFunction([composed.x], [ca.horzcat(*composed.positions).T])

        return self.functions.get("positions", compiled)

    def distance(self, x: Array, i: int, j: int) -> float:
        """Return the distance of the output points of agents i and j at the stacked state x [m]."""
        own, other = (self._outputs[self.names[l]](x[self.safe_set.parts[l]]) for l in (i, j))
        steps = zip(own.position.tolist(), other.position.tolist(), strict=True)
        return math.sqrt(added((p - q) * (p - q) for p, q in steps))

    def without_normal(self, turned: Collection[int]) -> Mask:
        """Return the pairs without a normal agent once these agents turned adversary, (p,)."""
        normal = np.isin(np.arange(self.pairs.every.max() + 1), [*set(self.normal) - {*turned}])
        without: Mask = np.logical_not(normal[self.pairs.every].any(axis=1))
        return without

    def heard_by(self, i: int) -> tuple[int, ...]:
        """Return the agents whose broadcasts agent i uses when it sees them."""
        if self.members[i].adversary or self.safety.centralised:
            return ()
        return tuple(j for j in self.normal if j != i)

    @cached_property
    def broadcasters(self) -> dict[str, Broadcaster]:
        """Each normal agent's, by name."""
        duration = self.scenario.duration
        # One sample comes too soon after a pause, a restart, or a clock that is set back.
        faults = Counter(each.agent for each in self.links.occurrences)
        return {
            self.names[i]: Broadcaster(
                i,
                len(self.members[i].dynamics.inputs),
                self.clock(i).most_samples(duration) + faults[self.names[i]],
                *self._radio(i),
            )
            for i in self.normal
        }

    @property
    def broadcast_every(self) -> int:
        """Most samples of an agent from one broadcast to the next."""
        return max((b.every for b in self.broadcasters.values()), default=1)

    def _radio(self, i: int) -> tuple[int, ...]:
        radio = self.groups[i].radio
        return (len(self.members[i].dynamics.states), radio.every, radio.relays) if radio else ()

    @property
    def synchronous(self) -> bool:
        """True if all normal agents sample at the same instants, as in Theorem 1."""
        clocks = [self.groups[l].clock for l in self.normal]
        return all(c.jitter == 0.0 and c.period == clocks[0].period for c in clocks)

    @cached_property
    def longest_horizon(self) -> float:
        """The largest τ of all normal agents [s]."""
        return max(self.horizon(i) for i in self.normal)

    @cached_property
    def disturbance_bounds(self) -> dict[str, float]:
        """φ_l^max of every agent, by name."""
        return {
            name: group.disturbance.bound
            for name, group in zip(self.names, self.groups, strict=True)
        }

    def clock(self, i: int) -> SamplingClock:
        """Return agent i's perturbed sampling clock.

        With robots that move by the wall clock nothing is drawn: the jitter is the machine's own.
        """
        clock, real = self.groups[i].clock, moves_by_itself(self.scenario.fresh_world())
        return SamplingClock(self.seeds, self.names[i], clock.period, 0.0 if real else clock.jitter)

    def horizon(self, i: int) -> float:
        """Return τ = Γ_i + δ_i^max + latency [s], the longest time from agent i's sample to the end
        of its input."""
        clock = self.groups[i].clock
        return clock.period + clock.jitter + self.time.latency

    def information(self) -> Information:
        """Return the model of which received inputs a row may use."""
        clocks = {l: self.groups[l].clock for l in self.sharing or self.normal}
        unchanged = {l: clock.period - clock.jitter for l, clock in clocks.items()}
        return self.safety.build_information(unchanged)

    @property
    def sharing(self) -> tuple[int, ...]:
        """Indices of the agents that rows expect to do their best while none is silent."""
        if not self.safety.information_model.shares:
            return ()
        return tuple(i for i in self.normal if self.groups[i].cooperates)

    def law(self, i: int) -> Law:
        """Build a new law for agent i. Raises ScenarioError if it does not fit the swarm."""
        law = self.groups[i].law_object()
        if not isinstance(law, TeamLaw):
            return law
        try:
            return law.join(i, self.members, self.scenario.obstacles)
        except ValueError as error:
            raise ScenarioError(f"{self.scenario.name}: law of {self.names[i]}: {error}") from error

    @property
    def controllers(self) -> bool:
        """True if some normal agent has a controller other than the paper's filter."""
        return not all(group.filtered for group in self.groups)

    @property
    def origins(self) -> list[Origin]:
        """The origins that inputs of normal agents may have."""
        of_agents = {"controller": self.controllers, "radio": self.by_radio}
        return origins_of_normal(self.safety.modes.union(k for k, on in of_agents.items() if on))

    def goal(self, i: int) -> AgentGoal:
        """Build agent i's goal; it may keep state, so that each controller has one of its own."""
        group = self.groups[i]
        reference = reference_of(self.scenario, i, group, self._number_in_group(i))
        return AgentGoal(self.names[i], group.axes, reference, self._outputs)

    def has_goal(self, i: int) -> bool:
        """Return whether agent i's law steers it to a goal, other than to stay where it is."""
        steers = self.groups[i].steers_by_goal
        return steers and not isinstance(self.goal(i).reference, Stay)

    @cached_property
    def _outputs(self) -> dict[str, Output]:
        return {
            m.name: Output(
                i, self.functions.get(("motion", g), partial(motion_function, m.dynamics))
            )
            for i, (g, m) in enumerate(zip(self.group_numbers, self.members, strict=True))
        }

    @cached_property
    def pair_sorts(self) -> Index:
        """The same number for pairs of the same groups and expressions, shape (p,)."""
        pairs, statics = self.pairs.every, [-1] * len(self.safe_set.obstacles)
        groups: Index = np.array([*self.group_numbers, *statics])
        sorts = np.column_stack([groups[pairs], self.pairs.kinds_of(pairs)])
        return np.unique(sorts, axis=0, return_inverse=True)[1].ravel()

    def h_of_pairs(self, x: Array) -> dict[str, Array]:
        """Return every pair's h at stacked states x, shape (s, n̄), as "<agent>-<agent>"."""
        composed, every = self.safe_set, self.pairs.choose(self.pairs.every)
        labels = [composed.label(pair) for pair in composed.pairs]
        h = np.empty((len(labels), len(x)))
        if len(x):
            h[every.order] = every.h(x).T
        return dict(zip(labels, h, strict=True))

    def start(self) -> Array:
        """Return x(0), shape (n̄,): each agent's start plus its spread, drawn by (seed, name)."""
        return self._x0.copy()

    @cached_property
    def _x0(self) -> Array:
        return np.concatenate([self._start(i) for i in range(len(self.members))])

    def _start(self, i: int) -> Array:
        group = self.groups[i]
        x = np.zeros(len(self.members[i].dynamics.states))
        if group.start:
            x[:] = group.start[self._number_in_group(i)]
        else:
            goal = self.goal(i)(0.0, {i: x})
            x[: len(goal.position)] = goal.position
        if group.spread:
            draw = Draws(self.seed, "start", self.names[i], width=len(x))[0]
            x += np.array(group.spread) * (2.0 * draw - 1.0)
        return x

    def _number_in_group(self, i: int) -> int:
        """Return the index of agent i in its group."""
        return self.groups[i].names.index(self.names[i])


def compiled_fields(scenario: Scenario) -> str:
    """Return as JSON all fields on which the compiled functions of a run depend.

    Not those of starts, laws, messages, faults and seeds, nor the numbers of spheres, which are
    arguments of the functions: seeds of a study draw these alone.
    """
    spheres = [k for k, each in enumerate(scenario.obstacles) if isinstance(each, Sphere)]
    agent_fields: dict[str, Any] = {
        "start": True,
        "spread": True,
        "law": True,
        "disturbance": {"kind", "every"},
    }
    free: dict[str, Any] = {
        **dict.fromkeys(("name", "description", "reading", "attack"), True),
        **dict.fromkeys(("duration", "seed", "reseed", "network", "faults"), True),
        "agents": {"__all__": agent_fields},
        "obstacles": {k: {"center", "clearance"} for k in spheres},
    }
    return scenario.model_dump_json(exclude=free)


def build_swarm(scenario: Scenario, functions: FunctionCache | None = None) -> Swarm:
    """Compose the scenario's safe set.

    functions: of scenarios with the same compiled_fields; None for new ones.

    Raises:
        ScenarioError: positions of different dimension, mixed relative degree, a wrong number of
            gains, or a user's expression that raises.
    """
    safety = scenario.safety
    members = [
        Member(name, group.dynamics_object(), group.role == "adversary")
        for name, group, _ in scenario.roster()
    ]
    try:
        function = safety.safe_set_function
        composed = compose(members, scenario.static, function, safety.rho)
        gains = len(safety.class_k)
        pairs = SwarmPairs(members, composed.obstacles, function, gains, functions)
    except (ValueError, EmptyPolytopeError) as error:
        raise ScenarioError(f"{scenario.name}: {error}") from error
    except Exception as error:  # CasADi's, on a user's expressions
        reason = str(error).strip().splitlines()[-1]
        raise ScenarioError(f"{scenario.name}: the safe set cannot be built: {reason}") from error
    return Swarm(scenario, composed, pairs)


def unit_of_psi(scenario: Scenario, k: int = 0) -> str:
    """Return the unit of ψ_k: of h per second to the power k, such as "m²/s²".

    It is "" if the functions of pairs and limits have no attribute `unit`, or different ones.
    """
    limits = [limit.boundary.limit for limit in scenario.limits]
    functions = [scenario.safety.safe_set_function, *limits]
    units = {getattr(function, "unit", "") for function in functions}
    of_h = str(units.pop()) if len(units) == 1 else ""
    if not of_h or k == 0:
        return of_h
    return f"{of_h}/s{'' if k == 1 else str(k).translate(_SUPERSCRIPT)}"


_SUPERSCRIPT = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
