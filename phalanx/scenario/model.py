"""The scenario as a whole, in SI units."""

import hashlib
import shlex
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from html import escape
from itertools import combinations, count, islice
from typing import Annotated, Any, Self, cast

import numpy as np
from pydantic import (
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    RootModel,
    Tag,
    model_validator,
)
from pydantic.json_schema import SkipJsonSchema

from phalanx.faults.fault import RunFacts
from phalanx.network.draws import Seeds
from phalanx.network.table import Network
from phalanx.scenario.agents import AgentGroup
from phalanx.scenario.attack import Attack
from phalanx.scenario.declared import AnyFault, Links
from phalanx.scenario.placement import Flows, Scatter
from phalanx.scenario.safety import Safety
from phalanx.schema.fields import (
    BOX,
    CONTROLLER,
    LIMIT,
    POLYGON,
    SPHERE,
    WALL,
    Finite,
    Name,
    NonNegative,
    Positive,
    Strict,
    Table,
    built,
    field_error,
)
from phalanx.schema.json_schema import OfKind
from phalanx.schema.notebook import html_table
from phalanx.theory.laws.formation import Formation
from phalanx.theory.models.world import World, require_clock
from phalanx.theory.safety.function import Boundary, Limit, Static
from phalanx.theory.safety.obstacles import Box, Obstacle, Polygon, Sphere, Wall


class ScenarioError(ValueError):
    """The scenario cannot be run; the message names file, field, expected and got."""


Seed = Annotated[int, Field(ge=0, lt=2**63)]
MAX_AGENTS = 256
_SHOWN = 12
"""Most names of a group in a notebook."""


_BY_FIELD = {"normal": WALL, "size": BOX, "corners": POLYGON}
"""The kind of an obstacle by a field that no other kind has; else it is a sphere."""


def _kind_of_obstacle(value: Any) -> str:
    known = value if isinstance(value, dict) else getattr(value, "__dict__", {})
    return next((kind for field, kind in _BY_FIELD.items() if field in known), SPHERE)


ObstacleField = Annotated[
    Annotated[Sphere, Tag(SPHERE)]
    | Annotated[Wall, Tag(WALL)]
    | Annotated[Box, Tag(BOX)]
    | Annotated[Polygon, Tag(POLYGON)],
    Discriminator(_kind_of_obstacle),
]


class LimitField(RootModel[Annotated[Table, OfKind(Limit)]]):
    """A [[limits]] table and its Limit."""

    model_config = ConfigDict(frozen=True)
    _limit: Limit = PrivateAttr()

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        self._limit = built(LIMIT, Limit, self.root)
        return self

    @property
    def boundary(self) -> Boundary:
        """The limit as the second member of pairs."""
        return Boundary(self._limit)


class Time(Strict):
    """The clock of the run."""

    latency: NonNegative = 0.0
    """Time from an agent's sample until its input is applied and broadcast [s]."""
    integration_step: Annotated[Positive, Field(le=1e-3)] = 1e-3
    """Longest step of the plant's fourth-order Runge-Kutta [s]."""
    recording_step: NonNegative = 0.0
    """Least time between two states in the recording [s]; 0 records one at every event."""
    lookahead: bool = True
    """In a swarm with limited sensing: let agents compute in parallel that cannot see each other
    before both have answered. The trajectory is the same."""
    timeout: Positive = 30.0
    """Longest wait of the plant for an agent, in wall time [s]."""


class Reseed(Strict):
    """A time from which on all that is random is drawn again."""

    at: Positive
    """[s]"""
    seed: Seed


class Reading(Strict):
    """Source and overrides of a scenario; they have no effect on the run."""

    source: str
    """The file, or the name of a shipped scenario."""
    overrides: dict[str, str] = Field(default_factory=dict)
    """Values of overridden fields by path, as TOML."""

    def command(self, seed: int) -> str:
        """Return the command that repeats the run from its source."""
        chosen = [
            part for path, toml in self.overrides.items() for part in ("--set", f"{path}={toml}")
        ]
        return shlex.join(["phalanx", "run", self.source, "--seed", str(seed), *chosen])


class Scenario(Strict):
    """A whole run, reproducible from this alone."""

    name: Name
    description: str = ""
    duration: Positive
    """[s] of virtual time."""
    seed: Seed = 0
    reseed: tuple[Reseed, ...] = ()
    """Seeds in force from given times on, in the place of `seed`."""
    time: Time = Time()
    safety: Safety
    network: Network = Network()
    faults: tuple[AnyFault, ...] = ()
    formation: Formation | None = None
    flows: Flows | None = None
    """Goals of agents without another, and their starts unless given."""
    obstacles: tuple[ObstacleField, ...] = ()
    limits: tuple[LimitField, ...] = ()
    """Conditions of every normal agent alone, such as { type = "fence", center, radius }."""
    scatter: Scatter | None = None
    """Obstacles drawn at random; a resolved scenario has them in `obstacles` instead."""
    world: Annotated[Table, OfKind(World)] | None = None
    """Simulator of the robots, { type = "package.module:Name", ... }; default: the agents' declared
    dynamics with drawn disturbances."""
    agents: Annotated[tuple[AgentGroup, ...], Field(min_length=1)]
    workspace: dict[str, tuple[Finite, Finite]] = Field(default_factory=dict)
    """Least and largest value of states by name, for the constants of `phalanx check`; positions
    and angles have defaults."""
    attack: Attack | None = None
    """The knobs of a search for attacks (`phalanx attack`); a run does not use them."""

    reading: SkipJsonSchema[Reading | None] = None
    """None if load did not read the scenario from a file."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        # Before any work for each agent, or each pair.
        if (size := sum(group.size for group in self.agents)) > MAX_AGENTS:
            raise field_error(("agents",), f"expected at most {MAX_AGENTS} agents", size)
        names = [name for group in self.named() for name in group.names]
        name, number = Counter(names).most_common(1)[0]
        if number > 1:
            raise field_error(("agents",), f"expected every name once, got {name!r} twice", names)
        joined = any("-" in name for name in names)
        pairs = Counter(f"{a}-{b}" for a, b in combinations(names, 2) if joined)
        if doubled := [label for label, number in pairs.items() if number > 1]:
            message = f"expected names without two pairs that are both called {doubled[0]}"
            raise field_error(("agents",), message, names)
        if all(group.role == "adversary" for group in self.agents):
            raise field_error(("agents",), "expected at least one normal agent", "adversaries only")
        for index, group in enumerate(self.agents):
            self._check_places(index, group)
            self._check_radio(index, group)
            if group.role == "normal" and group.sensing and self.safety.centralised:
                message = "expected no value: with safety.control = 'centralised' all is seen"
                raise field_error(("agents", index, "sensing"), message, group.sensing)
            field, own = (
                ("program", group.program) if group.program else ("controller", group.controller)
            )
            if own and self.safety.centralised:
                message = (
                    "expected none: with safety.control = 'centralised' one QP decides for all"
                )
                raise field_error(("agents", index, field), message, own)
            gap = group.clock.period - group.clock.jitter
            if self.time.latency >= gap:
                message = f"expected less than {gap:g} s, the shortest time between two samples"
                raise field_error(("time", "latency"), message, self.time.latency)
        if self.time.latency and self.safety.prove:
            message = "expected 0: with safety.prove inputs are proven from the sample"
            raise field_error(("time", "latency"), message, self.time.latency)
        for index, obstacle in enumerate(self.obstacles):
            self._check_axes(index, obstacle)
        for index, link in enumerate(self.network.links):
            link.check_names(names, ("network", "links", index))
        self._check_workspace()
        self._check_reseed()
        self._check_robots()
        agents = {name: group.facts for group in self.named() for name in group.names}
        for index, fault in enumerate(self.faults):
            fault.check(agents, ("faults", index))
        if self.attack is not None:
            self.attack.check(agents, ("attack",))
        return self

    def _check_radio(self, index: int, group: AgentGroup) -> None:
        safety = self.safety
        unfit = {
            "safety.control = 'distributed'": safety.centralised,
            "safety.composition = 'pairs'": not safety.pairwise,
            "safety.information = 'split'": not safety.information_model.shares,
            **{f"safety.{mode} = false": True for mode in sorted(safety.modes - {"keep"})},
            "no time.latency": self.time.latency > 0.0,
        }
        if group.radio is not None and (needed := [name for name, bad in unfit.items() if bad]):
            message = f"expected none without {', '.join(needed)}"
            raise field_error(("agents", index, "radio"), message, group.radio)

    def _check_robots(self) -> None:
        world = self.fresh_world()
        if world is None or not hasattr(world, "require_robots"):
            return
        groups = self.named()
        try:
            world.require_robots({n: g.dynamics_object() for g in groups for n in g.names})
        except ValueError as error:
            raise field_error(("world",), str(error), self.world) from error

    def fresh_world(self) -> World | None:
        """Build the world that the table describes, if there is one."""
        return None if self.world is None else cast(World, built("world", World, self.world))

    def require_clock(self, real_time: float | None) -> None:
        """Raise ValueError if the scenario cannot run by this clock.

        real_time: seconds of virtual time per second of wall time; None in lockstep.
        """
        require_clock(self.fresh_world(), real_time)
        if real_time is not None and self.safety.watch and not self.time.latency:
            raise ValueError(
                "safety.watch: expected false in real time without a time.latency: inputs take "
                "effect later than agents announce, and that would convict honest ones"
            )

    def _check_workspace(self) -> None:
        each = (state for group in self.agents for state in group.dynamics_object().states)
        states = tuple(dict.fromkeys(each))
        for name, (least, largest) in self.workspace.items():
            if name not in states:
                message = f"expected bounds of states, {', '.join(states)}"
                raise field_error(("workspace",), message, name)
            if not least < largest:
                message = "expected the least value first, then the largest"
                raise field_error(("workspace", name), message, [least, largest])

    def _check_reseed(self) -> None:
        before = 0.0
        for index, each in enumerate(self.reseed):
            if not before < each.at < self.duration:
                message = f"expected more than {before:g} s, and less than the run's duration"
                raise field_error(("reseed", index, "at"), message, each.at)
            before = each.at

    def _check_places(self, index: int, group: AgentGroup) -> None:
        where = ("agents", index, "slots")
        if group.slots and self.formation is None:
            raise field_error(where, "expected a [formation] that has slots", group.slots)
        if self.formation and any(slot >= self.formation.slots for slot in group.slots):
            highest = self.formation.slots - 1
            raise field_error(where, f"expected slots 0 to {highest}", group.slots)
        if not (group.slots or group.start or self.flows):
            message = "expected slots or start, or [flows] in which it starts"
            raise field_error(where[:2], message, "none of them")
        if self.flows and group.axes != self.agents[0].axes:
            message = f"expected {self.agents[0].axes} axes, as the group before it has in [flows]"
            raise field_error((*where[:2], "dynamics"), message, group.axes)

    def _check_axes(self, index: int, obstacle: Obstacle) -> None:
        # CasADi would take a center of one number for all axes.
        fields: dict[type, str] = {Wall: "normal", Polygon: "corners"}
        field = fields.get(type(obstacle), "center")
        given, axes = getattr(obstacle, field), self.agents[0].axes
        if len(given[0] if isinstance(obstacle, Polygon) else given) != axes:
            message = f"expected {axes} coordinates, as the agents' positions have"
            raise field_error(("obstacles", index, field), message, given)

    @np.errstate(all="ignore")  # of numbers so large that there is no room
    def resolved(self) -> "Scenario":
        """Return the scenario with names instead of counts, and random starts and obstacles drawn.

        Raises ValidationError if there is no room.
        """
        return self.model_copy(update={"agents": self.named()})._placed()._scattered()

    def named(self) -> tuple[AgentGroup, ...]:
        """Return every group with names; a count becomes unused numbers from 1 on."""
        taken = {name for group in self.agents for name in group.names}
        free = (str(n) for n in count(1) if str(n) not in taken)
        return tuple(
            group.model_copy(update={"names": tuple(islice(free, group.count)), "count": None})
            if group.count
            else group
            for group in self.agents
        )

    def _placed(self) -> "Scenario":
        """Return the scenario with the starts and obstacles of [flows]."""
        if self.flows is None:
            return self
        roster, groups, axes = list(self.roster()), [], self.agents[0].axes
        try:
            places, drawn = self.flows.draw(self.seed, len(roster), axes)
        except ValueError as error:
            raise field_error(("flows",), str(error), self.flows) from error
        free = iter(places)
        for group in self.agents:
            own = np.zeros((group.size, len(group.dynamics_object().states)))
            own[:, :axes] = list(islice(free, group.size))
            given = group.slots or group.start
            start = group.start if given else tuple(map(tuple, own.tolist()))
            groups.append(group.model_copy(update={"start": start}))
        update = {
            "agents": tuple(groups),
            "obstacles": self.obstacles + drawn,
            "flows": replace(self.flows, obstacles=0.0),
        }
        return self.model_copy(update=update)

    def _scattered(self) -> "Scenario":
        """Return the scenario with the obstacles of [scatter]."""
        if self.scatter is None:
            return self
        if self.formation is None:
            raise field_error(("scatter",), "expected a [formation] to lie around", None)
        axes = len(self.formation.path[0])
        starts = [
            np.array(group.start[place][:axes])
            if group.start
            else self.formation.goal(group.slots[place], 0.0).position
            for _, group, place in self.roster()
        ]
        try:
            drawn = self.scatter.draw(self.seed, self.formation, starts)
        except ValueError as error:
            raise field_error(("scatter",), str(error), self.scatter) from error
        return self.model_copy(update={"obstacles": self.obstacles + drawn, "scatter": None})

    def __repr__(self) -> str:
        normal = sum(group.size for group in self.agents if group.role == "normal")
        adversaries = sum(group.size for group in self.agents) - normal
        agents = f"{normal} normal and {adversaries} adversary agents"
        return f"Scenario({self.name!r}, {agents}, {self.duration:g} s, seed {self.seed})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return the groups of agents for a notebook."""
        rows = [
            (
                ", ".join(group.names[:_SHOWN]) + (", ..." if group.size > _SHOWN else ""),
                f"{group.size} {group.role}",
                str(group.dynamics["type"]),
                str(group.law["type"]),
                f"{1e3 * group.clock.period:g} ms",
            )
            for group in self.agents
        ]
        head = ("agents", "role", "dynamics", "law", "period")
        text = f"{self.name}: {self.description}, {self.duration:g} s, seed {self.seed}"
        return f"<p>{escape(text)}</p>{html_table(rows, head)}"

    def roster(self) -> Iterator[tuple[str, AgentGroup, int]]:
        """Yield every agent in order: name, group, place in the group."""
        for group in self.agents:
            for place, name in enumerate(group.names):
                yield name, group, place

    def links(self) -> Links:
        """Build the link models and faults of a run."""
        names = tuple(name for name, _, _ in self.roster())
        seeds = Seeds(self.seed, [(each.at, each.seed) for each in self.reseed])
        return Links(self.network, self.faults, RunFacts(names, self.duration, seeds))

    @property
    def static(self) -> tuple[Static, ...]:
        """Everything static that agents keep away from: obstacles, then limits."""
        return (*self.obstacles, *(limit.boundary for limit in self.limits))

    def programs_by_zenoh(self) -> frozenset[str]:
        """Return the agents whose own programs take part in the run in their place."""
        return frozenset(
            name for name, group, _ in self.roster() if group.program and group.protocol == "zenoh"
        )

    def programs(self) -> dict[str, tuple[str, ...]]:
        """Return the processes except the plant, each with the agents whose inputs it computes."""
        if not self.safety.centralised:
            return {name: (name,) for name, _, _ in self.roster()}
        normal = tuple(name for name, group, _ in self.roster() if group.role == "normal")
        adversaries = {n: (n,) for n, group, _ in self.roster() if group.role == "adversary"}
        return {CONTROLLER: normal, **adversaries}


def digest(scenario: Scenario) -> str:
    """Return a hash of the resolved scenario, by which programs check that they have the same."""
    content = scenario.model_copy(update={"reading": None})
    return hashlib.blake2b(to_json(content).encode(), digest_size=8).hexdigest()


def to_json(scenario: Scenario) -> str:
    """Return the resolved scenario with all defaults."""
    return scenario.model_dump_json(by_alias=True)
