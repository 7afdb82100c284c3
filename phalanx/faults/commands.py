"""Commands to a running run, from a user or a declared fault, and the state that results.

A command on an agent is one line of EFFECTS: its effect on the agent and on its process. Clocks,
judge, event log and page use that table, so a new command is added there.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Annotated, NamedTuple

import msgspec


class CommandKind(StrEnum):
    """One kind of command, with the meaning of `value` and `agent`."""

    PAUSE = "pause"
    """Virtual time stands still."""
    RESUME = "resume"
    STEP = "step"
    """Advance by `value` seconds of virtual time, then pause."""
    SPEED = "speed"
    """At most `value` seconds of virtual time per second; 0: as fast as the machine allows."""
    LOSS = "loss"
    """Every agent-to-agent link loses a broadcast with probability `value`."""
    DELAY = "delay"
    """Every agent-to-agent link takes `value` seconds."""
    KILL = "kill"
    """`agent`'s process dies; its actuator holds the last input."""
    RESTART = "restart"
    """A new process replaces the dead `agent`, with nothing received, and samples at once."""
    FREEZE = "freeze"
    """`agent` neither samples nor answers; its actuator holds the last input."""
    THAW = "thaw"
    """`agent` samples again, at once."""
    TURN = "turn"
    """`agent` applies u_i^max of Eq. (adversarialu) from now on, and still broadcasts."""
    HIJACK = "hijack"
    """The same, but `agent` goes on broadcasting the inputs of its own controller."""


class Condition(StrEnum):
    """An agent's health."""

    FINE = "fine"
    FROZEN = "frozen"
    DEAD = "dead"
    TURNED = "turned"
    """A normal agent that became an adversary in the run."""

    @property
    def silent(self) -> bool:
        """Return whether it neither samples nor answers."""
        return self in (Condition.FROZEN, Condition.DEAD)


class ProcessChange(StrEnum):
    """A change of an agent's process."""

    STOPS = "stops"
    GOES_ON = "goes on"
    DIES = "dies"
    STARTS = "starts"
    """A new process, with nothing received."""


class Effect(NamedTuple):
    """The effect of a command on its agent."""

    text: str
    """The event log's, after the agent's name."""
    valid_in: frozenset[Condition]
    """Conditions in which the command has an effect."""
    new_condition: Condition | None
    """None: the condition before the failure."""
    process: ProcessChange | None = None
    is_failure: bool = True
    """True if the agent fails, False if a failure ends."""


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
        is_failure=False,
    ),
    CommandKind.FREEZE: Effect("frozen", _RUNS, Condition.FROZEN, ProcessChange.STOPS),
    CommandKind.THAW: Effect(
        "thawed", frozenset({Condition.FROZEN}), None, ProcessChange.GOES_ON, is_failure=False
    ),
    CommandKind.TURN: Effect("turned adversary", frozenset({Condition.FINE}), Condition.TURNED),
    CommandKind.HIJACK: Effect(
        "hijacked: it attacks, and broadcasts inputs that it does not apply",
        frozenset({Condition.FINE}),
        Condition.TURNED,
    ),
}
"""Effects of all commands on agents."""
LINK_COMMANDS = frozenset({CommandKind.LOSS, CommandKind.DELAY})


class Command(msgspec.Struct, frozen=True):
    """One command, executed at t; recorded under the topic /command."""

    t: float
    """[s]"""
    kind: str
    """One of CommandKind; a text, so that an unknown kind gets an error message."""
    agent: str = ""
    value: float = 0.0
    fault: int = -1
    """Number of the declared fault that it executes; -1: sent by a user."""

    @property
    def effect(self) -> Effect | None:
        """Its effect on its agent; None if it does not concern an agent."""
        return EFFECTS.get(self.kind)

    @property
    def changes_trajectory(self) -> bool:
        """True if agents or links are affected; the other commands only change the pace."""
        return self.effect is not None or self.kind in LINK_COMMANDS

    @property
    def is_failure(self) -> bool:
        """True if it makes an agent fail, or changes links."""
        return self.kind in LINK_COMMANDS or (self.effect is not None and self.effect.is_failure)

    def __str__(self) -> str:
        """Return the command as a line of the event log."""
        if self.effect is not None:
            return f"agent {self.agent} {self.effect.text}"
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
    """The right to command a run, and scheduled commands. By default neither exists."""

    schedule: tuple[Command, ...] = ()
    """Commands at their virtual times; with those sent by users, a recorded run is repeated."""
    secret: bytes = field(default=b"", repr=False)
    """Programs that have it may command the run; empty: none may."""
    speed: float = 0.0
    """Initial speed, as for CommandKind.SPEED."""
    real_time: bool = False
    """Whether virtual time follows the wall clock, which cannot go as fast as possible."""


NO_COMMANDS = CommandPolicy()


def refusal(command: Command, names: tuple[str, ...]) -> str | None:
    """Return why a command is invalid in a swarm of these agents; None if it is valid."""
    if command.kind not in set(CommandKind):
        return f"kind: expected one of {', '.join(CommandKind)}, got {command.kind!r}"
    if command.effect is not None and command.agent not in names:
        return f"agent: expected one of {', '.join(names)}, got {command.agent!r}"
    highest = 1.0 if command.kind == CommandKind.LOSS else 1e6
    if not 0.0 <= command.value <= highest:
        return f"value: expected 0 to {highest:g}, got {command.value}"
    return None


def require_valid(commands: Iterable[Command], names: tuple[str, ...]) -> None:
    """Raise ValueError if a command is invalid in a swarm of these agents."""
    for command in commands:
        if why := refusal(command, names):
            raise ValueError(why)


class ActiveCommands(msgspec.Struct, array_like=True, frozen=True, kw_only=True):
    """Commands in force for one agent, repeated in each of its samples."""

    loss: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] | None = None
    """Replaces the scenario's loss on every link to this agent."""
    delay: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] | None = None
    """Replaces the scenario's delay [s] on every link to this agent."""
    adversary: bool = False
    """Attack from now on."""
    die: bool = False
    """End at once, without an answer."""
    hidden: bool = False
    """While it attacks, broadcast the inputs of its own controller."""


class FaultState:
    """Every agent's condition, and loss and delay of all links as commands set them."""

    def __init__(self, names: tuple[str, ...]) -> None:
        """names: all agents, in the scenario's order."""
        self.condition = [Condition.FINE for _ in names]
        self.loss: float | None = None
        self.delay: float | None = None
        self.turned: set[int] = set()
        """Agents that became adversaries, whatever happened to them since."""
        self._names = names
        self._hidden: set[int] = set()

    def apply(self, command: Command) -> int | None:
        """Update the state by a command. Return the agent whose condition changed, if any."""
        if command.kind == CommandKind.LOSS:
            self.loss = command.value
        if command.kind == CommandKind.DELAY:
            self.delay = command.value
        if (effect := command.effect) is None:
            return None
        i = self._names.index(command.agent)
        if self.condition[i] not in effect.valid_in:
            return None
        if effect.new_condition is Condition.TURNED:
            self.turned.add(i)
            self._hidden |= {i} if command.kind == CommandKind.HIJACK else set()
        before = Condition.TURNED if i in self.turned else Condition.FINE
        self.condition[i] = effect.new_condition or before
        return i

    def active_commands(self, i: int) -> ActiveCommands | None:
        """Return the commands that agent i's samples carry; None if none concerns it."""
        if self.loss is None and self.delay is None and i not in self.turned:
            return None
        turned, hidden = i in self.turned, i in self._hidden
        return ActiveCommands(loss=self.loss, delay=self.delay, adversary=turned, hidden=hidden)


def turns(names: Sequence[str], commands: Iterable[Command]) -> dict[str, float]:
    """Return the time [s] at which each agent became an adversary by these commands, in order."""
    state, times = FaultState(tuple(names)), dict[str, float]()
    for command in commands:
        changed = state.apply(command)
        if changed is not None and state.condition[changed] is Condition.TURNED:
            times.setdefault(names[changed], command.t)
    return times
