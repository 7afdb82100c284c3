"""Lies: broadcasts of a compromised agent claim another input than the one that it applies.

A lie is a pure function of seed, agent, step and receiver, and of the input applied. The plant
knows that input, so it computes afterwards which of the declared lies a false claim was.
"""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Discriminator, Field, Tag, model_validator

from phalanx.faults.fault import (
    AgentFacts,
    FieldPath,
    LinkRules,
    RunFacts,
    TimedFault,
    require_names,
)
from phalanx.network.draws import Draws, Seeds
from phalanx.network.inbox import AnnouncedInput
from phalanx.network.rule import Cut
from phalanx.schema.fields import INPUT, WORD, Name, Sent, field_error

_LIES = ("says", "equivocate", "replay", "apply_time", "shift", "drift", "silent")


def _word_or_input(value: Any) -> str:
    return WORD if isinstance(value, str) else INPUT


class LieFault(TimedFault):
    """An agent's broadcasts make a false claim; the agent still applies its own input."""

    kind: Literal["lie"]
    agent: Name
    to: tuple[Name, ...] = ()
    """Peers that receive the lie; the others receive the truth. Default: all peers."""
    says: (
        Annotated[
            Annotated[Literal["opposite", "zero"], Tag(WORD)]
            | Annotated[tuple[Sent, ...], Tag(INPUT)],
            Discriminator(_word_or_input),
        ]
        | None
    ) = None
    """The input that it claims to apply: this one, the opposite of its own, or zero."""
    equivocate: Literal[True] | None = None
    """Claim another input to every peer at every step, with components between u and -u."""
    replay: Annotated[int, Field(ge=1, strict=True)] | None = None
    """Claim the input and state of so many steps ago, with a new sequence number."""
    apply_time: Sent | None = None
    """Claim that its input takes effect so much later than it does [s]; negative: earlier."""
    shift: tuple[Sent, ...] | None = None
    """By radio: state this sum with its own state."""
    drift: tuple[Sent, ...] | None = None
    """The same, but a sum that grows by this each second from `at` on."""
    silent: Literal[True] | None = None
    """Send no broadcasts."""

    @model_validator(mode="after")
    def _one_lie(self) -> Self:
        declared = [field for field in _LIES if getattr(self, field) is not None]
        if len(declared) != 1:
            raise field_error((), f"expected one of {', '.join(_LIES)}", declared or "none")
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: FieldPath) -> None:
        """Raise ValidationError for an unknown name, or an input of a wrong size."""
        require_names([self.agent], agents, (*where, "agent"))
        require_names(self.to, [n for n in agents if n != self.agent], (*where, "to"))
        size = len(agents[self.agent].inputs)
        if isinstance(self.says, tuple) and len(self.says) != size:
            raise field_error((*where, "says"), f"expected {size} components", self.says)
        for field in ("shift", "drift"):
            states, change = len(agents[self.agent].states), getattr(self, field)
            if change is not None and len(change) != states:
                raise field_error((*where, field), f"expected {states} components", change)

    def is_for(self, receiver: str) -> bool:
        """Return whether this peer receives the lie."""
        return not self.to or receiver in self.to

    def on_links(self, run: RunFacts, index: int) -> LinkRules:
        """Return a cut of the agent's links to the receivers of the lie, if it is silent."""
        cut = (self.during(Cut()),) if self.silent else ()
        return lambda link: (
            cut
            if link.of == "broadcast" and link.sender == self.agent and self.is_for(link.receiver)
            else ()
        )


Past = Callable[[int], AnnouncedInput | None]
"""What an agent applied so many steps ago, and its state; None if there was nothing."""


class PeerClaim(NamedTuple):
    """The claim that one peer receives."""

    claim: AnnouncedInput
    lies: tuple[int, ...]
    """Numbers of the declared lies that changed it."""


class Lies:
    """The declared lies of one agent; simultaneous lies change the claim one after the other."""

    def __init__(self, seeds: Seeds, name: str, declared: Mapping[int, LieFault]) -> None:
        """Keep the lies of one agent among those declared, by number."""
        lies = {number: fault for number, fault in declared.items() if fault.agent == name}
        self.declared = {number: fault for number, fault in lies.items() if not fault.silent}
        self.steps_back = max((fault.replay or 0 for fault in lies.values()), default=0)
        """The most steps that a replay goes back."""
        self._seeds, self._name = seeds, name

    def claim(
        self, receiver: str, k: int, truth: AnnouncedInput, past: Past, now: float
    ) -> PeerClaim:
        """Return the claim that broadcast k makes to one peer; decided now [s]."""
        claim, changed_by = truth, list[int]()
        for number, fault in self.declared.items():
            if fault.at <= truth.t_apply < fault.end and fault.is_for(receiver):
                before, claim = claim, self._changed(claim, fault, receiver, k, past, now)
                changed_by += [number] if claim != before else []
        return PeerClaim(claim, tuple(changed_by))

    def _changed(
        self, claim: AnnouncedInput, fault: LieFault, receiver: str, k: int, past: Past, now: float
    ) -> AnnouncedInput:
        t_apply, u, x = claim.t_apply, claim.u, claim.x
        if fault.apply_time is not None:
            return AnnouncedInput(t_apply + fault.apply_time, u, x)
        if (change := fault.shift or fault.drift) is not None:
            grown = 1.0 if fault.shift else now - fault.at
            moved = [value + grown * more for value, more in zip(x, change, strict=bool(x))]
            return AnnouncedInput(t_apply, u, tuple(moved))
        if isinstance(fault.says, tuple):
            u = fault.says
        elif fault.says is not None:
            u = tuple(-value if fault.says == "opposite" else 0.0 for value in u)
        elif fault.replay is not None:
            old = past(fault.replay)
            return AnnouncedInput(t_apply, old.u, old.x) if old else claim
        else:
            seed = self._seeds.at(now)
            draws = Draws(seed, "equivocation", self._name, receiver, width=len(u))[k]
            pairs = zip(u, draws.tolist(), strict=True)
            u = tuple(value * (2.0 * draw - 1.0) for value, draw in pairs)
        return AnnouncedInput(t_apply, u, x)
