"""The [[agents]] tables: groups of agents with dynamics, law, goals, clock and disturbance."""

from functools import cached_property, partial
from typing import Annotated, Any, Literal, Self

import casadi as ca
from pydantic import (
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    RootModel,
    field_validator,
    model_validator,
)

from phalanx.faults.fault import AgentFacts
from phalanx.schema.fields import (
    REFERENCE,
    Finite,
    Name,
    NonNegative,
    Positive,
    Strict,
    Table,
    Unquoted,
    built,
    field_error,
)
from phalanx.schema.json_schema import OfKind, Schema
from phalanx.schema.registry import is_users
from phalanx.schema.user_code import names_user_code, require_program
from phalanx.theory.expressions.cache import cached, cached_for
from phalanx.theory.expressions.user_methods import MistakenMethodError
from phalanx.theory.laws.goals import Reference
from phalanx.theory.laws.law import Controller, Law
from phalanx.theory.models.dynamics import Dynamics, require_sound


class GoalField(RootModel[Annotated[Table, OfKind(Reference)]]):
    """An agent's goal: { type = "path", points, speed }, for example, or a point [x, y]."""

    model_config = ConfigDict(frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _table(cls, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return {"type": "point", "position": value}
        if not isinstance(value, dict | GoalField):
            raise ValueError("expected a point such as [4.0, 2.0], or a table with a type")
        return value

    @model_validator(mode="after")
    def _resolve(self) -> "GoalField":
        self.reference()
        return self

    def reference(self) -> Reference:
        """Build the reference that the table describes; it is one agent's own."""
        found: Reference = built(REFERENCE, Reference, self.root)
        return found

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: GetJsonSchemaHandler) -> Schema:
        return {"anyOf": [{"type": "array", "items": {"type": "number"}}, handler(core)]}

    @property
    def axes(self) -> int | None:
        """Dimension of the goal's space; None of a user's class, which is asked at x(0)."""
        return None if is_users(self.root) else getattr(self.reference(), "axes", None)

    def __repr__(self) -> str:
        return repr(self.root)


class Clock(Strict):
    """Sampling clock of agents."""

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
    """φ_i: linear between knots, with ‖φ_i‖ <= bound everywhere."""

    bound: NonNegative
    """φ_i^max, on the Euclidean norm."""
    every: Positive = 0.2
    """Time between knots [s]."""
    kind: Literal["random", "adverse"] = "random"
    """Random: knots uniform in the cube inscribed in the ball. Adverse: knots along ∂ψ_{q-1}/∂x_i
    at full size, one knot late."""


class Radio(Strict):
    """Knowledge of peers, the normal agents with a radio, by their broadcasts alone."""

    every: Annotated[int, Field(ge=1, strict=True)] = 1
    """Samples from one broadcast to the next."""
    relays: Annotated[int, Field(ge=0, strict=True)] = 0
    """Most statements of others that a broadcast repeats."""
    gain: Positive | None = None
    """κ of own parts [1/s]; default: 1.2 / broadcast period, and at most 1/(e τ)."""
    starts_known: bool = True
    """Whether agents know where their peers are at t = 0; else they stand until they hear them."""
    position_error: NonNegative = 0.0
    """Bound on the error of an agent's own measured position [m]."""
    speed_error: NonNegative = 0.0
    """Likewise of its speed [m/s]."""
    stamp_error: NonNegative = 0.0
    """Bound on the error of the times that broadcasts state [s]."""
    belief: Literal["set", "newest", "carried-on"] = "set"
    """Where a peer is: anywhere that it can be since its newest broadcast; as that has it, as if it
    were now; or carried on from there by speed and input. The last two are to compare with."""
    rows: Literal["own-parts", "halves"] = "own-parts"
    """Conditions for peers: each agent's own part of a braking distance, or halves of pairs' rows,
    which need one believed state."""

    @model_validator(mode="after")
    def _halves_of_points(self) -> Self:
        if self.rows == "halves" and self.belief == "set":
            message = "expected 'own-parts' where belief is 'set': halves need one believed state"
            raise field_error(("rows",), message, self.rows)
        return self


class AgentGroup(Strict):
    """Agents that differ only in name and start."""

    names: tuple[Name, ...] = ()
    count: Annotated[int, Field(ge=1, strict=True)] | None = None
    """Number of agents, instead of names; a resolved scenario has names."""
    role: Literal["normal", "adversary"]
    dynamics: Annotated[Table, OfKind(Dynamics)]
    """For example { type = "unicycle", speed = 4.0, turn_rate = 2.0 }."""
    law: Annotated[Table, OfKind(Law)]
    """A normal agent's nominal law, or an adversary's attack."""
    controller: Annotated[Table, OfKind(Controller)] | None = None
    """What makes a normal agent's input, for example { type = "cbf-qp" }; default: the paper's
    filter."""
    program: tuple[str, ...] = ()
    """A user's own program in place of a controller, with its arguments: ["./my_agent"]."""
    protocol: Literal["stdio", "zenoh"] = "stdio"
    """Whether the program gets a line of JSON for each sample and answers by one, or takes part in
    the run itself, as docs/wire.md has it."""
    filter: bool = False
    """Whether the paper's filter acts on the program's input, as on that of a nominal law."""
    keeps: Literal["halves", "own-parts"] | None = None
    """The rule that the program's inputs keep, which others then count on; by default none, or with
    filter the filter's."""
    clock: Clock
    disturbance: Disturbance = Disturbance(bound=0.0)
    sensing: Positive | None = None
    """Radius within which an agent sees others and receives their broadcasts [m]; default:
    safety.neighbourhood for normal agents, no limit for adversaries."""
    radio: Radio | None = None
    """Its agents know others with a radio by what these broadcast of themselves, not by sensing."""
    slots: tuple[Annotated[int, Field(ge=0)], ...] = ()
    """The formation slot of each agent: its goal, and its start unless start is given."""
    goal: tuple[GoalField, ...] = ()
    """The goal of each agent, instead of a slot: a point [m], or a table with a type. Without goal,
    slots and flows an agent stays where it starts."""
    start: tuple[tuple[Finite, ...], ...] = ()
    """Each agent's state at t = 0."""
    spread: tuple[NonNegative, ...] = ()
    """Half-widths of a uniform draw added to each component of the start."""

    _dynamics: Dynamics = PrivateAttr()
    _law: Law = PrivateAttr()

    @field_validator("goal", mode="before")
    @classmethod
    def _list_of_goals(cls, value: Any) -> Any:
        if not isinstance(value, list | tuple) or (value and isinstance(value[0], int | float)):
            raise ValueError("expected a list with one for each agent, such as [[4.0, 2.0]]")
        return value

    @model_validator(mode="after")
    def _resolve(self) -> Self:
        self._dynamics = built("dynamics", Dynamics, self.dynamics)
        try:
            cached_for([self._dynamics], "sound", partial(require_sound, self._dynamics))
        except MistakenMethodError as error:
            raise field_error(("dynamics",), error.expected, Unquoted(error.got)) from error
        self._law = self.fresh_law() if self._names_user_code else self.law_object()
        if self.controller is not None:
            if self.role == "adversary":
                message = "expected none for adversaries, whose law is the attack"
                raise field_error(("controller",), message, self.controller)
            self.fresh_controller()
        self._check_program()
        if self.radio is not None and self.role == "adversary":
            message = "expected none for adversaries, who sense everybody within their radius"
            raise field_error(("radio",), message, self.radio)
        if bool(self.names) == (self.count is not None):
            got = "both" if self.names else "neither"
            raise field_error((), "expected names, or a count and no names", got)
        for field, per_agent in (
            ("slots", self.slots),
            ("start", self.start),
            ("goal", self.goal),
        ):
            if per_agent and len(per_agent) != self.size:
                message = f"expected one for each of the {self.size} agents"
                raise field_error((field,), message, per_agent)
        states = self._dynamics.states
        for field, vectors in (("start", self.start), ("spread", (self.spread or states,))):
            if any(len(vector) != len(states) for vector in vectors):
                message = f"expected {len(states)} components {states}"
                raise field_error((field,), message, getattr(self, field))
        if self.goal:
            self._check_goals()
        return self

    def _check_program(self) -> None:
        """Raise unless the program, if there is one, is trusted, and what describes it fits."""
        rows = self.radio.rows if self.radio else "halves"
        alone = self.radio is not None and not self.cooperates
        wrong = {
            "expected none for adversaries, whose law is the attack": self.role == "adversary",
            "expected none beside a controller": self.controller is not None,
            "expected none with filter and protocol = 'zenoh': it sends its inputs itself": (
                self.filter and self.protocol == "zenoh"
            ),
            f"expected with it keeps = '{rows}' or filter = true: its peers count on it": alone,
        }
        for message in [words for words, found in wrong.items() if found and self.program]:
            raise field_error(("program",), message, list(self.program))
        for field in ("filter", "keeps"):
            if getattr(self, field) and not self.program:
                message = "expected none without a program"
                raise field_error((field,), message, getattr(self, field))
        if self.keeps not in (None, rows):
            raise field_error(("keeps",), f"expected '{rows}', as the others have", self.keeps)
        if self.program:
            require_program(self.program)

    @property
    def filtered(self) -> bool:
        """True if the paper's filter makes the agents' inputs."""
        return self.controller is None and (self.filter or not self.program)

    @property
    def cooperates(self) -> bool:
        """True if others count on it to keep its part; a program has to say so."""
        return not self.program or self.filter or self.keeps is not None

    def _check_goals(self) -> None:
        if self.slots:
            raise field_error(("goal",), "expected goal or slots, not both", self.slots)
        if not self.steers_by_goal:
            message = f"expected none: the law {self.law['type']} does not steer by a goal"
            raise field_error(("goal",), message, [goal.root for goal in self.goal])
        for place, goal in enumerate(self.goal):
            if goal.axes not in (None, self.axes):
                message = f"expected {self.axes} coordinates, as the agents' positions have"
                raise field_error(("goal", place), message, goal.root)

    @property
    def size(self) -> int:
        """Number of agents."""
        return self.count or len(self.names)

    @cached_property
    def axes(self) -> int:
        """Dimension of the space in which the agents move: 2 or 3."""
        state = ca.SX.sym("x", len(self._dynamics.states))
        return int(self._dynamics.position(state).numel())

    @property
    def steers_by_goal(self) -> bool:
        """True if the agents' law uses their goals, unless it has the attribute `without_goal`."""
        return not getattr(self._law, "without_goal", False)

    @property
    def facts(self) -> AgentFacts:
        """Properties of each agent that faults need."""
        dynamics = self._dynamics
        return AgentFacts(self.role == "adversary", dynamics.states, dynamics.inputs)

    def dynamics_object(self) -> Dynamics:
        """Return the dynamics that the table describes."""
        return self._dynamics

    def fresh_law(self) -> Law:
        """Build the law that the table describes, and prepare it for new dynamics."""
        law: Law = built("law", Law, self.law)
        dynamics = built("dynamics", Dynamics, self.dynamics)
        try:
            law.prepare(dynamics)
        except MistakenMethodError as error:
            raise field_error(("law",), error.expected, Unquoted(error.got)) from error
        except ValueError as error:  # it does not fit the dynamics
            raise field_error(("law",), str(error), self.law) from error
        return law

    def fresh_controller(self) -> Controller | None:
        """Build one agent's controller, if a table describes one; it is not prepared."""
        if self.controller is None:
            return None
        controller: Controller = built("controller", Controller, self.controller)
        return controller

    def law_object(self) -> Law:
        """Return one agent's law, prepared; a user's law may have a state, built-in ones do not."""
        if not self._names_user_code:
            # In each thread another: a compiled law writes to buffers.
            return cached(("law", repr(self.law), repr(self.dynamics)), self.fresh_law)
        return self.fresh_law() if names_user_code(self.law) else self._law

    @property
    def _names_user_code(self) -> bool:
        return names_user_code([self.law, self.dynamics])
