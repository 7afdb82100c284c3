"""Lies: what a compromised member says of its input to its peers, instead of what it applies.

A lie is a pure function of seed, agent, step and receiver, and of what the agent applies. So the
plant, which knows that, finds out afterwards which of the declared lies it was.
"""

from collections.abc import Callable, Mapping
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Discriminator, Field, Tag, model_validator

from phalanx.faults.fault import AgentFacts, LinkRules, RunFacts, TimedFault, Where
from phalanx.network.inbox import Claim
from phalanx.network.rule import Cut
from phalanx.schema.fields import INPUT, WORD, Finite, Name, misplaced
from phalanx.seeded.draws import Draws

_LIES = ("says", "equivocate", "replay", "apply_time", "silent")


def _word_or_input(value: Any) -> str:
    return WORD if isinstance(value, str) else INPUT


class LieFault(TimedFault):
    """An agent says of its input to its peers what is not so; it applies what it would apply."""

    kind: Literal["lie"]
    agent: Name
    to: tuple[Name, ...] = ()
    """Peers that hear the lie; the others hear the truth. By default all are lied to."""
    says: (
        Annotated[
            Annotated[Literal["opposite", "zero"], Tag(WORD)]
            | Annotated[tuple[Finite, ...], Tag(INPUT)],
            Discriminator(_word_or_input),
        ]
        | None
    ) = None
    """That it applies this input, the opposite of its input, or none."""
    equivocate: Literal[True] | None = None
    """To every peer something else."""
    replay: Annotated[int, Field(ge=1, strict=True)] | None = None
    """The input that it applied so many steps ago."""
    apply_time: Finite | None = None
    """That its input takes effect so much later than it does [s]; negative: earlier."""
    silent: Literal[True] | None = None
    """Nothing."""

    @model_validator(mode="after")
    def _one_lie(self) -> Self:
        told = [field for field in _LIES if getattr(self, field) is not None]
        if len(told) != 1:
            raise misplaced((), f"expected one of {', '.join(_LIES)}", told or "none")
        return self

    def check(self, agents: Mapping[str, AgentFacts], where: Where) -> None:
        """Raise ValidationError for a name that nobody has, or an input of a wrong size."""
        if self.agent not in agents:
            message = f"expected an agent's name, of {[*agents]}"
            raise misplaced((*where, "agent"), message, self.agent)
        peers = [name for name in agents if name != self.agent]
        for name in self.to:
            if name not in peers:
                raise misplaced((*where, "to"), f"expected others' names, of {peers}", name)
        size = len(agents[self.agent].inputs)
        if isinstance(self.says, tuple) and len(self.says) != size:
            raise misplaced((*where, "says"), f"expected {size} components", self.says)

    def tells(self, receiver: str) -> bool:
        """Whether this peer hears it."""
        return not self.to or receiver in self.to

    def on_links(self, run: RunFacts, place: int) -> LinkRules:
        """Of a liar that is silent nothing comes through."""
        cut = (self.during(Cut()),) if self.silent else ()
        return lambda link: (
            cut
            if link.of == "broadcast" and link.sender == self.agent and self.tells(link.receiver)
            else ()
        )

    def lie(self) -> "Lie":
        """The claim in place of the truth."""
        if isinstance(self.says, tuple):
            return says(self.says)
        if self.says is not None:
            return says_opposite if self.says == "opposite" else says_zero
        if self.replay is not None:
            return replays(self.replay)
        return equivocates if self.apply_time is None else misdates(self.apply_time)


Past = Callable[[int], tuple[float, ...] | None]
"""The input that an agent applied so many steps ago; None if there was none."""


class Telling(NamedTuple):
    """An agent about to tell one peer of its input."""

    seed: int
    sender: str
    receiver: str
    k: int
    """The broadcast's number."""
    claim: Claim
    """The truth, or the claim that the lies before have made of it."""
    past: Past


Lie = Callable[[Telling], Claim]
"""The claim in place of it."""


def says(u: tuple[float, ...]) -> Lie:
    """It says that it applies u, whatever it applies."""
    return lambda telling: Claim(telling.claim.t_apply, u)


def says_zero(telling: Telling) -> Claim:
    """It says that it applies nothing."""
    return Claim(telling.claim.t_apply, tuple(0.0 for _ in telling.claim.u))


def says_opposite(telling: Telling) -> Claim:
    """It says that it applies the opposite."""
    return Claim(telling.claim.t_apply, tuple(-value for value in telling.claim.u))


def equivocates(telling: Telling) -> Claim:
    """It tells every peer another input, at every step, with components between u and -u."""
    claim = telling.claim
    table = Draws(
        telling.seed, "equivocation", telling.sender, telling.receiver, width=len(claim.u)
    )
    turned = zip(claim.u, table[telling.k].tolist(), strict=True)
    return Claim(claim.t_apply, tuple(value * (2.0 * draw - 1.0) for value, draw in turned))


def replays(steps: int) -> Lie:
    """It says what it applied so many steps ago, as if it were new.

    An old broadcast as it was, number and all, is refused by peers that had it.
    """

    def told(telling: Telling) -> Claim:
        old = telling.past(steps)
        return telling.claim if old is None else Claim(telling.claim.t_apply, old)

    return told


def misdates(later: float) -> Lie:
    """It says that its input takes effect so much later than it does [s]; earlier if negative."""
    return lambda telling: Claim(telling.claim.t_apply + later, telling.claim.u)


class Told(NamedTuple):
    """The claim to one peer."""

    claim: Claim
    lies: tuple[int, ...]
    """Numbers of the declared lies that changed it."""


class Lies:
    """One agent's lies, as declared: one made of the other, where several are told at once."""

    def __init__(self, seed: int, name: str, declared: Mapping[int, LieFault]) -> None:
        """declared: by number; those of other agents do not count."""
        own = {n: fault for n, fault in declared.items() if fault.agent == name}
        self.declared = {n: (f, f.lie()) for n, f in own.items() if not f.silent}
        self.reach = max((fault.replay or 0 for fault in own.values()), default=0)
        """The number of steps that the lies look back."""
        self._seed, self._name = seed, name

    def tell(self, receiver: str, k: int, truth: Claim, past: Past) -> Told:
        """The claim to one peer in broadcast k."""
        claim, told = truth, []
        for number, (fault, lie) in self.declared.items():
            if fault.at <= truth.t_apply < fault.end and fault.tells(receiver):
                before = claim
                claim = lie(Telling(self._seed, self._name, receiver, k, claim, past))
                told += [number] if claim != before else []
        return Told(claim, tuple(told))
