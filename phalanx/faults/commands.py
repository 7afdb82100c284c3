"""Commands: what a person may do to a run while it runs, live or at scheduled times."""

from dataclasses import dataclass, field
from enum import StrEnum

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
    def changes_trajectory(self) -> bool:
        """Whether agents or links are affected; the other commands only change the pace."""
        return self.kind in ON_AGENTS | ON_LINKS


STRIKES = frozenset({CommandKind.KILL, CommandKind.FREEZE, CommandKind.TURN})
"""Those that make an agent fail; the others on agents end that."""
ON_AGENTS = STRIKES | {CommandKind.RESTART, CommandKind.THAW}
ON_LINKS = frozenset({CommandKind.LOSS, CommandKind.DELAY})


@dataclass(frozen=True)
class CommandPolicy:
    """Who may command a run, and which commands are scheduled. By default nobody, and none."""

    schedule: tuple[Command, ...] = ()
    """Commands at their virtual times: those by hand of a recording make the same run again."""
    secret: bytes = field(default=b"", repr=False)
    """Who has it may command the run; empty: nobody may."""
    speed: float = 0.0
    """As CommandKind.SPEED, from the start."""


NO_COMMANDS = CommandPolicy()
"""Nobody may command the run, and nothing is scheduled."""


def refusal(command: Command, names: tuple[str, ...]) -> str | None:
    """Why a command cannot be obeyed in a swarm of these agents, in words; None if it can."""
    if command.kind not in set(CommandKind):
        return f"kind: expected one of {', '.join(CommandKind)}, got {command.kind!r}"
    if command.kind in ON_AGENTS and command.agent not in names:
        return f"agent: expected one of {', '.join(names)}, got {command.agent!r}"
    highest = 1.0 if command.kind == CommandKind.LOSS else 1e6
    if not 0.0 <= command.value <= highest:
        return f"value: expected 0 to {highest:g}, got {command.value}"
    return None


def described(command: Command) -> str:
    """The command as a line of the event log."""
    match command.kind:
        case CommandKind.LOSS:
            return f"every link loses {command.value:.0%}"
        case CommandKind.DELAY:
            return f"every link takes {1e3 * command.value:g} ms"
        case CommandKind.SPEED:
            return f"speed {command.value:g}" if command.value else "speed: as fast as possible"
        case CommandKind.STEP:
            return f"step by {command.value:g} s"
        case CommandKind.KILL:
            return f"agent {command.agent} killed"
        case CommandKind.RESTART:
            return f"agent {command.agent} restarted, with nothing received"
        case CommandKind.FREEZE:
            return f"agent {command.agent} frozen"
        case CommandKind.THAW:
            return f"agent {command.agent} thawed"
        case CommandKind.TURN:
            return f"agent {command.agent} turned adversary"
        case _:
            return command.kind
