"""The state that commands leave behind: who is frozen, dead or turned, and what links do."""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import Annotated

import msgspec

from phalanx.faults.commands import ON_AGENTS, Command, CommandKind


class Condition(StrEnum):
    """How an agent does."""

    FINE = "fine"
    FROZEN = "frozen"
    DEAD = "dead"
    TURNED = "turned"
    """A normal agent that became an adversary in the run."""


class Orders(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """What commands ask of an agent, in every sample from then on."""

    loss: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] | None = None
    """Replaces the scenario's loss on every link to this agent."""
    delay: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] | None = None
    """Replaces the scenario's delay [s] on every link to this agent."""
    adversary: bool = False
    """Attack from now on."""
    die: bool = False
    """End at once, without an answer."""


_LEADS_ON_FROM: dict[str, set[Condition]] = {
    CommandKind.KILL: {Condition.FINE, Condition.TURNED, Condition.FROZEN},
    CommandKind.RESTART: {Condition.DEAD},
    CommandKind.FREEZE: {Condition.FINE, Condition.TURNED},
    CommandKind.THAW: {Condition.FROZEN},
    CommandKind.TURN: {Condition.FINE},
}
"""In which conditions a command has an effect; in others it has none."""


class FaultState:
    """Every agent's condition, and what commands made of the links."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """names: of all agents, in the scenario's order."""
        self.condition = [Condition.FINE for _ in names]
        self.loss: float | None = None
        self.delay: float | None = None
        self._names = names
        self._turned: set[int] = set()

    def silent(self, i: int) -> bool:
        """Whether agent i neither samples nor answers."""
        return self.condition[i] in (Condition.FROZEN, Condition.DEAD)

    def obey(self, command: Command) -> int | None:
        """Take a command in. Returns the agent whose condition it changed, if it did."""
        match command.kind:
            case CommandKind.LOSS:
                self.loss = command.value
            case CommandKind.DELAY:
                self.delay = command.value
            case kind if kind in ON_AGENTS:
                return self._change(self._names.index(command.agent), kind)
        return None

    def _change(self, i: int, kind: str) -> int | None:
        if self.condition[i] not in _LEADS_ON_FROM[kind]:
            return None
        if kind == CommandKind.TURN:
            self._turned.add(i)
        self.condition[i] = {
            CommandKind.KILL: Condition.DEAD,
            CommandKind.FREEZE: Condition.FROZEN,
        }.get(CommandKind(kind), Condition.TURNED if i in self._turned else Condition.FINE)
        return i

    def orders(self, i: int) -> Orders | None:
        """What agent i's samples have to tell it; None while no command concerns it."""
        if self.loss is None and self.delay is None and i not in self._turned:
            return None
        return Orders(loss=self.loss, delay=self.delay, adversary=i in self._turned)


def turns(names: Sequence[str], commands: Iterable[Command]) -> dict[str, float]:
    """Which agents became adversaries by these commands, in order, and when [s]."""
    state, found = FaultState(tuple(names)), dict[str, float]()
    for command in commands:
        changed = state.obey(command)
        if changed is not None and command.kind == CommandKind.TURN:
            found[names[changed]] = command.t
    return found
