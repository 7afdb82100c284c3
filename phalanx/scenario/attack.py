"""The [attack] table: the knobs of a search for attacks, with their bounds."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from phalanx.faults.fault import AgentFacts, FieldPath, require_names
from phalanx.schema.fields import Distribution, Finite, Name, NonNegative, Strict, field_error

Interval = tuple[Finite, Finite]
"""Least and largest value."""
Kind = Literal[
    "lie", "loss", "hold", "partition", "pause", "kill", "turn", "clock", "sensor", "actuator"
]


class FaultBudget(Strict):
    """Faults that a search may add to a scenario."""

    most: Annotated[int, Field(ge=1, le=8, strict=True)]
    """Most faults at once."""
    kinds: Annotated[tuple[Kind, ...], Field(min_length=1)]
    """A lie is one of a normal agent; loss, hold and partition are of broadcasts."""
    agents: tuple[Name, ...] = ()
    """Agents that may have them; default: the normal ones."""
    longest: Annotated[Finite, Field(gt=0)] = 2.0
    """Longest duration of each [s]."""


class Attack(Strict):
    """Bounds of all that a search may change, and the starts that it must leave out."""

    vary: dict[str, Distribution] = Field(default_factory=dict)
    """Bounds or choices of any field, by its path: { "agents.1.law.gain" = { uniform = [1, 9] } }.
    """
    starts: dict[Name, Annotated[tuple[Interval, ...], Field(min_length=1)]] = Field(
        default_factory=dict
    )
    """By agent, the box of its start: the least and the largest value of each state."""
    scripts: dict[Name, Annotated[int, Field(ge=1, le=64, strict=True)]] = Field(
        default_factory=dict
    )
    """By adversary, the number of constant inputs of U_j that replace its law, each in force for
    the same time."""
    faults: FaultBudget | None = None
    certified: Annotated[NonNegative, Field(le=8.0)] = 8.0
    """Each start must leave every pair a certificate of so many τ, with some input."""
    apart: NonNegative = 0.0
    """Least distance of each adversary from each normal agent at the start [m]."""

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        for name, box in self.starts.items():
            for state, (low, high) in enumerate(box):
                if low > high:
                    message = "expected the least value first, then the largest"
                    raise field_error(("starts", name, state), message, [low, high])
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        """Raise ValidationError unless it fits the scenario's agents, by name."""
        require_names(self.starts, agents, (*where, "starts"))
        for name, box in self.starts.items():
            if len(box) != len(states := agents[name].states):
                message = f"expected {len(states)} intervals {states}"
                raise field_error((*where, "starts", name), message, box)
        adversaries = [name for name, facts in agents.items() if facts.adversary]
        require_names(self.scripts, adversaries, (*where, "scripts"))
        if self.faults is not None:
            require_names(self.faults.agents, agents, (*where, "faults", "agents"))
