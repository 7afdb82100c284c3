"""The scenario as typed fields: SI units, defaults, and errors that name the field."""

import re
from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Tag,
    ValidationError,
    model_validator,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from phalanx.scenario.registry import construct
from phalanx.scenario.scatter import Scatter
from phalanx.theory.class_k import ClassK, Linear
from phalanx.theory.dynamics import Dynamics
from phalanx.theory.formation import Formation
from phalanx.theory.laws import Law
from phalanx.theory.margin import MarginConstants
from phalanx.theory.obstacles import Sphere, Wall
from phalanx.theory.row import Information
from phalanx.theory.safe_set import SafeSetFunction

MAX_AGENTS = 256
_PLANT = "plant"
CONTROLLER = "controller"
"""The process that decides for all normal agents where safety.control is "centralised"."""
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,31}")


def _check_name(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError("expected 1 to 32 of a-z 0-9 _ - (it becomes part of a key expression)")
    if name in (_PLANT, CONTROLLER):
        raise ValueError(f"expected another name: this one is the {name}'s")
    return name


Name = Annotated[str, AfterValidator(_check_name)]
Finite = Annotated[float, Field(allow_inf_nan=False, strict=True)]
Positive = Annotated[Finite, Field(gt=0)]
NonNegative = Annotated[Finite, Field(ge=0)]
Probability = Annotated[Finite, Field(ge=0, le=1)]
Table = dict[str, Any]
Composition = Literal["lse", "pairs"]
Margin = Literal["paper", "corrected", "local"]

NUMBER, TABLE, SPHERE, WALL = "number", "table", "sphere", "wall"
ALTERNATIVES = frozenset((NUMBER, TABLE, SPHERE, WALL))
"""Names of alternatives in an error's place, where fields are not called so."""


def _number_or_table(value: Any) -> str:
    return NUMBER if isinstance(value, int | float | str | None) else TABLE


ClassKField = Annotated[
    Annotated[Positive, Tag(NUMBER)] | Annotated[Table, Tag(TABLE)],
    Discriminator(_number_or_table),
]


def _sphere_or_wall(value: Any) -> str:
    has_normal = "normal" in value if isinstance(value, dict) else isinstance(value, Wall)
    return WALL if has_normal else SPHERE


ObstacleField = Annotated[
    Annotated[Sphere, Tag(SPHERE)] | Annotated[Wall, Tag(WALL)], Discriminator(_sphere_or_wall)
]


class Strict(BaseModel):
    """Unknown fields are errors; a scenario does not change once read."""

    model_config = ConfigDict(extra="forbid", frozen=True, arbitrary_types_allowed=True)


class Time(Strict):
    """The clock of the run."""

    latency: NonNegative = 0.0
    """From an agent's sample to its input being applied and broadcast [s]."""
    integration_step: Annotated[Positive, Field(le=1e-3)] = 1e-3
    """Longest step of the plant's fourth-order Runge-Kutta [s]."""
    timeout: Positive = 30.0
    """How long the plant waits for an agent, in wall time [s]."""


class Safety(Strict):
    """The safe set and the controller's choices."""

    function: Table
    """h of pairs, for example { type = "separation", radius = 1.0 }."""
    rho: Positive
    """ρ of LSE."""
    alpha: Annotated[tuple[ClassKField, ...], Field(min_length=1)]
    """α_1, ..., α_q: the gain of a linear one [1/s], or { type = "power", gain, exponent }."""
    control: Literal["distributed", "centralised"] = "distributed"
    """Each agent its own QP, or one controller the QP of Theorem 1, which needs synchronous
    clocks."""
    composition: Composition = "lse"
    """One row for h_tot = LSE of all pairs, as in the paper, or one row for each pair."""
    margin: Margin = "paper"
    """How η is made: as in the paper; corrected, with L_φ ψ_k for every k >= 1; or local, a bound
    computed at each sample, which needs neither eta nor xi."""
    margin_scale: Positive = 1.0
    """What the margin is multiplied with; below 1 nothing is proven."""
    eta: Annotated[
        Annotated[NonNegative, Tag(NUMBER)] | Annotated[MarginConstants, Tag(TABLE)],
        Discriminator(_number_or_table),
    ] = 0.0
    """The margin η: a number as given, or the constants of Lemma (constants) to compute it."""
    xi: NonNegative = 0.0
    """ξ of Eq. (xi); used when q > 1 and the margin is not local."""
    information: Information = Information.PAPER
    """What an agent assumes of the other normal agents' inputs."""
    silence: Positive = 1.0
    """A normal agent not heard of for longer counts at γ_l^max, like an adversary [s]."""
    neighbourhood: Positive | None = None
    """An agent composes only what lies within this distance of it [m]; default: everything."""
    authority: NonNegative = 0.01
    """Below this span max c_i u - min c_i u an agent's backup is futile."""

    _function: SafeSetFunction = PrivateAttr()
    _alpha: tuple[ClassK, ...] = PrivateAttr()

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        if self.control == "centralised" and self.composition == "pairs":
            message = "expected 'lse' where safety.control is 'centralised'"
            raise _error(("composition",), message, self.composition)
        if self.margin == "local" and self.eta:
            raise _error(("eta",), "expected no value: margin = 'local' computes it", self.eta)
        if self.margin != "local" and "eta" not in self.model_fields_set:
            raise _error(("eta",), "expected a value, or margin = 'local'", None)
        self._function = _construct("function", SafeSetFunction, self.function)
        self._alpha = tuple(
            _construct("alpha", ClassK, given) if isinstance(given, dict) else Linear(given)
            for given in self.alpha
        )
        return self

    def safe_set_function(self) -> SafeSetFunction:
        """The safe-set function that the table describes."""
        return self._function

    def class_k(self) -> tuple[ClassK, ...]:
        """α_1, ..., α_q as given or described by their tables."""
        return self._alpha


class UniformDelay(Strict):
    """A delay drawn anew for every message."""

    low: NonNegative
    """[s]"""
    high: NonNegative
    """[s]"""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(f"expected low <= high, got {self.low} > {self.high}")
        return self


Delay = Annotated[
    Annotated[NonNegative, Tag(NUMBER)] | Annotated[UniformDelay, Tag(TABLE)],
    Discriminator(_number_or_table),
]


class LinkModel(Strict):
    """What the network does to broadcasts on a link."""

    delay: Delay = 0.0
    """Constant [s], or { low, high } for a uniform draw."""
    loss: Probability = 0.0
    """Probability that a message is lost, independently of the others."""


class LinkOverride(LinkModel):
    """A link model for some links only; of several that match, the last counts."""

    sender: Name | Literal["*"] = Field(default="*", alias="from")
    receiver: Name | Literal["*"] = Field(default="*", alias="to")


class Network(LinkModel):
    """The model of every agent-to-agent link, and exceptions to it."""

    links: tuple[LinkOverride, ...] = ()

    def link(self, sender: str, receiver: str) -> LinkModel:
        """The model of one link."""
        chosen: LinkModel = self
        for override in self.links:
            if override.sender in ("*", sender) and override.receiver in ("*", receiver):
                chosen = override
        return chosen


class Clock(Strict):
    """When agents sample."""

    period: Positive
    """Γ_i [s]."""
    jitter: NonNegative = 0.0
    """δ_i^max [s]."""

    @model_validator(mode="after")
    def _advances(self) -> Self:
        if self.jitter >= self.period:
            raise ValueError(f"expected jitter < period = {self.period}, got {self.jitter}")
        return self


class Disturbance(Strict):
    """φ_i: straight lines between knots, ‖φ_i‖ <= bound everywhere."""

    bound: NonNegative
    """φ_i^max, on the Euclidean norm."""
    every: Positive = 0.2
    """Time between knots [s]."""
    kind: Literal["random", "adverse"] = "random"
    """Knots drawn uniformly in the cube inscribed in the ball; or along ∂ψ_{q-1}/∂x_i at full size,
    one knot late: the worst that a disturbance can do to the safe set."""


class AgentGroup(Strict):
    """Agents that share everything but their name and start."""

    names: Annotated[tuple[Name, ...], Field(min_length=1)]
    role: Literal["normal", "adversary"]
    dynamics: Table
    """For example { type = "unicycle", speed = 4.0, turn_rate = 2.0 }."""
    law: Table
    """A normal agent's nominal law, or an adversary's attack."""
    clock: Clock
    disturbance: Disturbance = Disturbance(bound=0.0)
    slots: tuple[Annotated[int, Field(ge=0)], ...] = ()
    """The formation slot of each agent: its goal, and its start unless start is given."""
    start: tuple[tuple[Finite, ...], ...] = ()
    """Each agent's state at t = 0."""
    spread: tuple[NonNegative, ...] = ()
    """Half-widths of a uniform draw added to each component of the start."""

    _dynamics: Dynamics = PrivateAttr()
    _law: Law = PrivateAttr()

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        self._dynamics = _construct("dynamics", Dynamics, self.dynamics)
        self._law = _construct("law", Law, self.law)
        try:
            self._law.prepare(self._dynamics)
        except ValueError as error:
            raise _error(("law",), str(error), self.law) from error
        for field, per_agent in (("slots", self.slots), ("start", self.start)):
            if per_agent and len(per_agent) != len(self.names):
                message = f"expected one for each of the {len(self.names)} names"
                raise _error((field,), message, per_agent)
        if not self.slots and not self.start:
            raise _error((), "expected slots or start, got neither", None)
        states = self._dynamics.states
        for field, vectors in (("start", self.start), ("spread", (self.spread,))):
            if any(vector and len(vector) != len(states) for vector in vectors):
                message = f"expected {len(states)} components {states}"
                raise _error((field,), message, getattr(self, field))
        return self

    def dynamics_object(self) -> Dynamics:
        """The dynamics that the table describes."""
        return self._dynamics

    def law_object(self) -> Law:
        """The law that the table describes, prepared."""
        return self._law


class Scenario(Strict):
    """A whole run, reproducible from this and nothing else."""

    name: Name
    description: str = ""
    duration: Positive
    """[s] of virtual time."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    time: Time = Time()
    safety: Safety
    network: Network = Network()
    formation: Formation | None = None
    obstacles: tuple[ObstacleField, ...] = ()
    scatter: Scatter | None = None
    """Obstacles to draw; a resolved scenario has them among its obstacles instead."""
    agents: Annotated[tuple[AgentGroup, ...], Field(min_length=1)]
    workspace: dict[str, tuple[Finite, Finite]] = {}
    """Least and largest value of states by name, for the constants of `phalanx check`; positions
    and angles have defaults."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [name for group in self.agents for name in group.names]
        for name in names:
            if names.count(name) > 1:
                raise _error(("agents",), f"expected every name once, got {name!r} twice", names)
        if len(names) > MAX_AGENTS:
            raise _error(("agents",), f"expected at most {MAX_AGENTS} agents", len(names))
        if all(group.role == "adversary" for group in self.agents):
            raise _error(("agents",), "expected at least one normal agent", "adversaries only")
        for index, group in enumerate(self.agents):
            self._check_slots(index, group)
        for index, link in enumerate(self.network.links):
            for field, name in (("from", link.sender), ("to", link.receiver)):
                if name != "*" and name not in names:
                    where = ("network", "links", index, field)
                    raise _error(where, f"expected an agent's name or '*', one of {names}", name)
        return self

    def _check_slots(self, index: int, group: AgentGroup) -> None:
        where = ("agents", index, "slots")
        if group.slots and self.formation is None:
            raise _error(where, "expected a [formation] that has slots", group.slots)
        if self.formation and any(slot >= self.formation.slots for slot in group.slots):
            highest = self.formation.slots - 1
            raise _error(where, f"expected slots 0 to {highest}", group.slots)

    def scattered(self) -> "Scenario":
        """This scenario with its random obstacles drawn. Raises ValidationError."""
        if self.scatter is None:
            return self
        if self.formation is None:
            raise _error(("scatter",), "expected a [formation] to lie around", None)
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
            raise _error(("scatter",), str(error), self.scatter) from error
        return self.model_copy(update={"obstacles": self.obstacles + drawn, "scatter": None})

    def roster(self) -> Iterator[tuple[str, AgentGroup, int]]:
        """Every agent in order: name, its group, its place in the group."""
        for group in self.agents:
            for place, name in enumerate(group.names):
                yield name, group, place

    def programs(self) -> list[str]:
        """Names of the processes beside the plant: every agent, or the controller of several."""
        if self.safety.control == "distributed":
            return [name for name, _, _ in self.roster()]
        return [CONTROLLER, *(n for n, group, _ in self.roster() if group.role == "adversary")]


def _construct(field: str, kind: type, table: Table) -> Any:
    """Build an object from its table; its errors become errors of this field."""
    try:
        return construct(kind, table)
    except ValidationError as error:
        lines = [
            InitErrorDetails(
                type=PydanticCustomError("value", "{msg}", {"msg": e["msg"]}),
                loc=(field, *e["loc"]),
                input=e["input"],
            )
            for e in error.errors()
        ]
        raise ValidationError.from_exception_data(field, lines) from error
    except ValueError as error:
        raise _error((field,), str(error), table.get("type")) from error


def _error(where: tuple[str | int, ...], message: str, value: Any) -> ValidationError:
    """A validation error at a place below the model that raises it."""
    problem = PydanticCustomError("value", "{msg}", {"msg": message})
    return ValidationError.from_exception_data(
        "scenario", [InitErrorDetails(type=problem, loc=where, input=value)]
    )
