"""Commands, of a person or of a declared fault, to a run while it runs; the state they leave.

A command on an agent is one line of EFFECTS: what becomes of the agent and of its process. Clocks,
judge, event log and page ask there, so that another one is added there.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, NamedTuple

import msgspec


class CommandKind(StrEnum):
    """One kind of command; `value` and `agent` mean what its text says."""

    PAUSE = "pause"
    """Virtual time stands still."""
    RESUME = "resume"
    STEP = "step"
    """Go on for `value` seconds of virtual time, then stand still."""
    SPEED = "speed"
    """At most `value` seconds of virtual time per second; 0: as fast as the machine allows."""
    LOSS = "loss"
    """Every agent-to-agent link loses a broadcast with probability `value`."""
    DELAY = "delay"
    """Every agent-to-agent link takes `value` seconds."""
    KILL = "kill"
    """`agent`'s process dies; its actuator holds the last input."""
    RESTART = "restart"
    """Another process takes the place of the dead `agent`, knows nothing, and samples at once."""
    FREEZE = "freeze"
    """`agent` neither samples nor answers; its actuator holds the last input."""
    THAW = "thaw"
    """`agent` samples again, at once."""
    TURN = "turn"
    """`agent` applies u_i^max of Eq. (adversarialu) from now on, and still broadcasts."""


class Condition(StrEnum):
    """An agent's health."""

    FINE = "fine"
    FROZEN = "frozen"
    DEAD = "dead"
    TURNED = "turned"
    """A normal agent that became an adversary in the run."""

    @property
    def silent(self) -> bool:
        """Whether it neither samples nor answers."""
        return self in (Condition.FROZEN, Condition.DEAD)


class ProcessChange(StrEnum):
    """A change of an agent's process."""

    STOPS = "stops"
    GOES_ON = "goes on"
    DIES = "dies"
    STARTS = "starts"
    """Anew, knowing nothing."""


class Effect(NamedTuple):
    """The effect of a command on its agent, in those conditions in which it has any."""

    in_words: str
    """As the event log has it, after the agent's name."""
    leads_from: frozenset[Condition]
    leads_to: Condition | None
    """None: what it was before it failed."""
    process: ProcessChange | None = None
    harms: bool = True
    """Whether the agent fails; else a failure ends."""


_RUNS = frozenset({Condition.FINE, Condition.TURNED})
EFFECTS: Mapping[str, Effect] = {
    CommandKind.KILL: Effect(
        "killed", _RUNS | {Condition.FROZEN}, Condition.DEAD, ProcessChange.DIES
    ),
    CommandKind.RESTART: Effect(
        "restarted, with nothing received",
        frozenset({Condition.DEAD}),
        None,
        ProcessChange.STARTS,
        harms=False,
    ),
    CommandKind.FREEZE: Effect("frozen", _RUNS, Condition.FROZEN, ProcessChange.STOPS),
    CommandKind.THAW: Effect(
        "thawed", frozenset({Condition.FROZEN}), None, ProcessChange.GOES_ON, harms=False
    ),
    CommandKind.TURN: Effect("turned adversary", frozenset({Condition.FINE}), Condition.TURNED),
}
"""Of every command on an agent."""
ON_LINKS = frozenset({CommandKind.LOSS, CommandKind.DELAY})


class Command(msgspec.Struct, frozen=True):
    """One command, obeyed at t; recorded under the topic /command."""

    t: float
    """[s]"""
    kind: str
    """One of CommandKind; a text here, so that what a stranger sends can be refused in words."""
    agent: str = ""
    value: float = 0.0
    fault: int = -1
    """Which of the scenario's declared faults it is, by number; -1: by hand."""

    @property
    def effect(self) -> Effect | None:
        """Its effect on its agent; None if it is on none."""
        return EFFECTS.get(self.kind)

    @property
    def changes_trajectory(self) -> bool:
        """Whether agents or links are affected; the other commands only change the pace."""
        return self.effect is not None or self.kind in ON_LINKS

    @property
    def harms(self) -> bool:
        """Whether it makes an agent fail, or changes what links do."""
        return self.kind in ON_LINKS or (self.effect is not None and self.effect.harms)

    def __str__(self) -> str:
        """The command as a line of the event log."""
        if self.effect is not None:
            return f"agent {self.agent} {self.effect.in_words}"
        match self.kind:
            case CommandKind.LOSS:
                return f"every link loses {self.value:.0%}"
            case CommandKind.DELAY:
                return f"every link takes {1e3 * self.value:g} ms"
            case CommandKind.SPEED:
                return f"speed {self.value:g}" if self.value else "speed: as fast as possible"
            case CommandKind.STEP:
                return f"step by {self.value:g} s"
        return str(self.kind)


@dataclass(frozen=True)
class CommandPolicy:
    """The right to command a run, and scheduled commands. By default nobody's, and none."""

    schedule: tuple[Command, ...] = ()
    """Commands at their virtual times: those by hand of a recording make the same run again."""
    secret: bytes = field(default=b"", repr=False)
    """Its holders may command the run; empty: nobody may."""
    speed: float = 0.0
    """As CommandKind.SPEED, from the start."""


NO_COMMANDS = CommandPolicy()
"""Nobody may command the run, and nothing is scheduled."""


def refusal(command: Command, names: tuple[str, ...]) -> str | None:
    """Why a command cannot be obeyed in a swarm of these agents, in words; None if it can."""
    if command.kind not in set(CommandKind):
        return f"kind: expected one of {', '.join(CommandKind)}, got {command.kind!r}"
    if command.effect is not None and command.agent not in names:
        return f"agent: expected one of {', '.join(names)}, got {command.agent!r}"
    highest = 1.0 if command.kind == CommandKind.LOSS else 1e6
    if not 0.0 <= command.value <= highest:
        return f"value: expected 0 to {highest:g}, got {command.value}"
    return None


class Orders(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Orders of commands to an agent, in every sample from then on."""

    loss: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] | None = None
    """Replaces the scenario's loss on every link to this agent."""
    delay: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] | None = None
    """Replaces the scenario's delay [s] on every link to this agent."""
    adversary: bool = False
    """Attack from now on."""
    die: bool = False
    """End at once, without an answer."""


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
        return self.condition[i].silent

    def obey(self, command: Command) -> int | None:
        """Take a command in. Returns the agent whose condition it changed, if it did."""
        if command.kind == CommandKind.LOSS:
            self.loss = command.value
        if command.kind == CommandKind.DELAY:
            self.delay = command.value
        if (effect := command.effect) is None:
            return None
        i = self._names.index(command.agent)
        if self.condition[i] not in effect.leads_from:
            return None
        if effect.leads_to is Condition.TURNED:
            self._turned.add(i)
        before = Condition.TURNED if i in self._turned else Condition.FINE
        self.condition[i] = effect.leads_to or before
        return i

    def orders(self, i: int) -> Orders | None:
        """Orders that agent i's samples carry; None while no command concerns it."""
        if self.loss is None and self.delay is None and i not in self._turned:
            return None
        return Orders(loss=self.loss, delay=self.delay, adversary=i in self._turned)


def turns(names: Sequence[str], commands: Iterable[Command]) -> dict[str, float]:
    """Which agents became adversaries by these commands, in order, and when [s]."""
    state, found = FaultState(tuple(names)), dict[str, float]()
    for command in commands:
        changed = state.obey(command)
        if changed is not None and state.condition[changed] is Condition.TURNED:
            found.setdefault(names[changed], command.t)
    return found
