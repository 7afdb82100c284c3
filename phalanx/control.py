"""What somebody may do to a run while it runs, and how it is asked for."""

from dataclasses import dataclass, field
from enum import StrEnum

from phalanx.recording.records import Control


class ControlKind(StrEnum):
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


ON_AGENTS = frozenset({ControlKind.KILL, ControlKind.FREEZE, ControlKind.THAW, ControlKind.TURN})
ON_LINKS = frozenset({ControlKind.LOSS, ControlKind.DELAY})


def steers(control: Control) -> bool:
    """Whether it changes the trajectory; the others only change the pace."""
    return control.kind in ON_AGENTS | ON_LINKS


def check(control: Control, names: tuple[str, ...]) -> str | None:
    """What is wrong with it, in words; None if it can be obeyed."""
    if control.kind not in set(ControlKind):
        return f"kind: expected one of {', '.join(ControlKind)}, got {control.kind!r}"
    if control.kind in ON_AGENTS and control.agent not in names:
        return f"agent: expected one of {', '.join(names)}, got {control.agent!r}"
    highest = 1.0 if control.kind == ControlKind.LOSS else 1e6
    if not 0.0 <= control.value <= highest:
        return f"value: expected 0 to {highest:g}, got {control.value}"
    return None


def words(control: Control) -> str:
    """The control as a line of the log."""
    match control.kind:
        case ControlKind.LOSS:
            return f"every link loses {control.value:.0%}"
        case ControlKind.DELAY:
            return f"every link takes {1e3 * control.value:g} ms"
        case ControlKind.SPEED:
            return f"speed {control.value:g}" if control.value else "speed: as fast as possible"
        case ControlKind.STEP:
            return f"step by {control.value:g} s"
        case ControlKind.KILL:
            return f"agent {control.agent} killed"
        case ControlKind.FREEZE:
            return f"agent {control.agent} frozen"
        case ControlKind.THAW:
            return f"agent {control.agent} thawed"
        case ControlKind.TURN:
            return f"agent {control.agent} turned adversary"
        case _:
            return control.kind


@dataclass(frozen=True)
class Steering:
    """How a run may be steered. By default, not at all."""

    schedule: tuple[Control, ...] = ()
    """Controls at their virtual times: those of a recording make the same run again."""
    secret: bytes = field(default=b"", repr=False)
    """Who has it may command the run; empty: nobody may."""
    speed: float = 0.0
    """As ControlKind.SPEED, from the start."""


UNSTEERED = Steering()
"""Nobody interferes, and nothing was scheduled."""
