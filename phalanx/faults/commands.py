"""What somebody may do to a run while it runs, and how it is asked for."""

from dataclasses import dataclass, field
from enum import StrEnum

from phalanx.recording.records import Command


class CommandKind(StrEnum):
    """One kind of intervention; `value` and `agent` mean what its text says."""

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
    FREEZE = "freeze"
    """`agent` neither samples nor answers; its actuator holds the last input."""
    THAW = "thaw"
    """`agent` samples again, at once."""
    TURN = "turn"
    """`agent` applies u_i^max of Eq. (adversarialu) from now on, and still broadcasts."""


ON_AGENTS = frozenset({CommandKind.KILL, CommandKind.FREEZE, CommandKind.THAW, CommandKind.TURN})
ON_LINKS = frozenset({CommandKind.LOSS, CommandKind.DELAY})


def changes_trajectory(control: Command) -> bool:
    """Whether it changes the trajectory; the others only change the pace."""
    return control.kind in ON_AGENTS | ON_LINKS


def check(control: Command, names: tuple[str, ...]) -> str | None:
    """What is wrong with it, in words; None if it can be obeyed."""
    if control.kind not in set(CommandKind):
        return f"kind: expected one of {', '.join(CommandKind)}, got {control.kind!r}"
    if control.kind in ON_AGENTS and control.agent not in names:
        return f"agent: expected one of {', '.join(names)}, got {control.agent!r}"
    highest = 1.0 if control.kind == CommandKind.LOSS else 1e6
    if not 0.0 <= control.value <= highest:
        return f"value: expected 0 to {highest:g}, got {control.value}"
    return None


def words(control: Command) -> str:
    """The control as a line of the log."""
    match control.kind:
        case CommandKind.LOSS:
            return f"every link loses {control.value:.0%}"
        case CommandKind.DELAY:
            return f"every link takes {1e3 * control.value:g} ms"
        case CommandKind.SPEED:
            return f"speed {control.value:g}" if control.value else "speed: as fast as possible"
        case CommandKind.STEP:
            return f"step by {control.value:g} s"
        case CommandKind.KILL:
            return f"agent {control.agent} killed"
        case CommandKind.FREEZE:
            return f"agent {control.agent} frozen"
        case CommandKind.THAW:
            return f"agent {control.agent} thawed"
        case CommandKind.TURN:
            return f"agent {control.agent} turned adversary"
        case _:
            return control.kind


@dataclass(frozen=True)
class CommandPolicy:
    """How a run may be steered. By default, not at all."""

    schedule: tuple[Command, ...] = ()
    """Controls at their virtual times: those of a recording make the same run again."""
    secret: bytes = field(default=b"", repr=False)
    """Who has it may command the run; empty: nobody may."""
    speed: float = 0.0
    """As CommandKind.SPEED, from the start."""


NO_COMMANDS = CommandPolicy()
"""Nobody interferes, and nothing was scheduled."""
