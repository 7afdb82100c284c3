"""The [[agents]] tables: who takes part, with which dynamics, law, clock and disturbance."""

from functools import cached_property
from typing import Annotated, Literal, Self

import casadi as ca
from pydantic import Field, PrivateAttr, model_validator

from phalanx.faults.fault import AgentFacts
from phalanx.schema.fields import (
    Finite,
    InWords,
    Name,
    NonNegative,
    Positive,
    Strict,
    Table,
    built,
    misplaced,
)
from phalanx.schema.registry import is_users
from phalanx.theory.expressions.asked import MistakenMethodError, ask
from phalanx.theory.laws.law import Law
from phalanx.theory.models.dynamics import Dynamics, require_sound


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

    names: tuple[Name, ...] = ()
    count: Annotated[int, Field(ge=1, strict=True)] | None = None
    """How many agents, instead of names; a resolved scenario has names."""
    role: Literal["normal", "adversary"]
    dynamics: Table
    """For example { type = "unicycle", speed = 4.0, turn_rate = 2.0 }."""
    law: Table
    """A normal agent's nominal law, or an adversary's attack."""
    clock: Clock
    disturbance: Disturbance = Disturbance(bound=0.0)
    sensing: Positive | None = None
    """How far each sees, and from where broadcasts reach it [m]; default: safety.neighbourhood for
    normal agents, no limit for adversaries."""
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
        self._dynamics = built("dynamics", Dynamics, self.dynamics)
        try:
            require_sound(self._dynamics)
        except MistakenMethodError as error:
            raise misplaced(("dynamics",), error.expected, InWords(error.got)) from error
        self._law = self.fresh_law()
        if bool(self.names) == (self.count is not None):
            got = "both" if self.names else "neither"
            raise misplaced((), "expected names, or a count and no names", got)
        for field, per_agent in (("slots", self.slots), ("start", self.start)):
            if per_agent and len(per_agent) != self.size:
                message = f"expected one for each of the {self.size} agents"
                raise misplaced((field,), message, per_agent)
        states = self._dynamics.states
        for field, vectors in (("start", self.start), ("spread", (self.spread,))):
            if any(vector and len(vector) != len(states) for vector in vectors):
                message = f"expected {len(states)} components {states}"
                raise misplaced((field,), message, getattr(self, field))
        return self

    @property
    def size(self) -> int:
        """The number of agents."""
        return self.count or len(self.names)

    @cached_property
    def axes(self) -> int:
        """Of the space in which the agents move: 2 or 3."""
        state = ca.SX.sym("x", len(self._dynamics.states))
        return int(self._dynamics.position(state).numel())

    @property
    def facts(self) -> AgentFacts:
        """Facts of each agent that faults ask for."""
        dynamics = self._dynamics
        return AgentFacts(self.role == "adversary", dynamics.states, dynamics.inputs)

    def dynamics_object(self) -> Dynamics:
        """The dynamics that the table describes."""
        return self._dynamics

    def fresh_law(self) -> Law:
        """The law that the table describes, built anew and prepared for dynamics of its own."""
        law: Law = built("law", Law, self.law)
        try:
            ask(law, "prepare", "no error", built("dynamics", Dynamics, self.dynamics))
        except MistakenMethodError as error:
            if isinstance(error.__cause__, ValueError):  # it does not fit the dynamics
                raise misplaced(("law",), str(error.__cause__), self.law) from error
            raise misplaced(("law",), error.expected, InWords(error.got)) from error
        return law

    def law_object(self) -> Law:
        """One agent's law, prepared: a user's may keep what it was asked, those built in do not."""
        return self.fresh_law() if is_users(self.law) else self._law
