"""The lies of [[faults]]: what a compromised member says to its peers of its input."""

from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from phalanx.faults import lies
from phalanx.scenario.fields import INPUT, WORD, Finite, Name, misplaced
from phalanx.scenario.timed import Timed

_LIES = ("says", "equivocate", "replay", "apply_time", "silent")


def _word_or_input(value: Any) -> str:
    return WORD if isinstance(value, str) else INPUT


class LieFault(Timed):
    """An agent says of its input to its peers what is not so; it applies what it would apply."""

    kind: Literal["lie"]
    agent: Name
    to: tuple[Name, ...] = ()
    """Whom it tells so; the others hear the truth. By default all are lied to."""
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
    """What it applied so many steps ago."""
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

    def check(self, names: list[str], where: tuple[str | int, ...]) -> None:
        """Raise ValidationError for a name that nobody has, or if it is to lie to itself."""
        if self.agent not in names:
            raise misplaced((*where, "agent"), f"expected an agent's name, of {names}", self.agent)
        peers = [name for name in names if name != self.agent]
        for name in self.to:
            if name not in peers:
                raise misplaced((*where, "to"), f"expected others' names, of {peers}", name)

    def check_input(self, size: int, where: tuple[str | int, ...]) -> None:
        """Raise ValidationError unless what it says is an input of so many components."""
        if isinstance(self.says, tuple) and len(self.says) != size:
            raise misplaced((*where, "says"), f"expected {size} components", self.says)

    def cut(self, names: list[str]) -> frozenset[tuple[str, str]]:
        """The links (sender, receiver) on which it says nothing."""
        peers = self.to or [name for name in names if name != self.agent]
        return frozenset((self.agent, name) for name in peers if self.silent)

    def declared(self, number: int) -> lies.DeclaredLie:
        """What is told instead of the truth, if this is rule `number` of the scenario."""
        return lies.DeclaredLie(number, self.at, self.end, frozenset(self.to), self._lie())

    def _lie(self) -> lies.Lie:
        if self.says is not None:
            named = {"opposite": lies.says_opposite, "zero": lies.says_zero}
            return lies.says(self.says) if isinstance(self.says, tuple) else named[self.says]
        if self.replay is not None:
            return lies.replays(self.replay)
        if self.apply_time is not None:
            return lies.misdates(self.apply_time)
        return lies.equivocates
