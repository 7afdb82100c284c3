"""Which agents are frozen, dead or turned, and what the network does by a control."""

from phalanx.faults.commands import CommandKind
from phalanx.recording.records import Command
from phalanx.wire.frames import Condition
from phalanx.wire.messages import Orders

_POSSIBLE: dict[str, set[Condition]] = {
    CommandKind.KILL: {Condition.FINE, Condition.TURNED, Condition.FROZEN},
    CommandKind.FREEZE: {Condition.FINE, Condition.TURNED},
    CommandKind.THAW: {Condition.FROZEN},
    CommandKind.TURN: {Condition.FINE},
}
"""From which conditions a control can lead on; elsewhere it does nothing."""


class Faults:
    """The state that commands leave behind."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self.condition = dict.fromkeys(range(len(names)), Condition.FINE)
        self.loss: float | None = None
        self.delay: float | None = None
        self._names = names
        self._turned: set[int] = set()

    def silent(self, i: int) -> bool:
        """Whether agent i neither samples nor answers."""
        return self.condition[i] in (Condition.FROZEN, Condition.DEAD)

    def obey(self, control: Command) -> int | None:
        """Take a control in. Returns the agent whose condition it changed, if it did."""
        match control.kind:
            case CommandKind.LOSS:
                self.loss = control.value
            case CommandKind.DELAY:
                self.delay = control.value
            case CommandKind.KILL | CommandKind.FREEZE | CommandKind.THAW | CommandKind.TURN:
                return self._change(self._names.index(control.agent), control.kind)
        return None

    def _change(self, i: int, kind: str) -> int | None:
        if self.condition[i] not in _POSSIBLE[kind]:
            return None
        if kind == CommandKind.TURN:
            self._turned.add(i)
        self.condition[i] = {
            CommandKind.KILL: Condition.DEAD,
            CommandKind.FREEZE: Condition.FROZEN,
            CommandKind.TURN: Condition.TURNED,
            CommandKind.THAW: Condition.TURNED if i in self._turned else Condition.FINE,
        }[CommandKind(kind)]
        return i

    def orders(self, i: int) -> Orders | None:
        """What agent i's samples have to tell it; None while there was no control."""
        if self.loss is None and self.delay is None and i not in self._turned:
            return None
        return Orders(self.loss, self.delay, i in self._turned)
