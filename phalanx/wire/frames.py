"""What the plant shows to viewers, and what those with the command secret may ask of it."""

import msgspec

from phalanx.faults.commands import Command, Condition
from phalanx.guarantee.verdict import Assumption, Violation
from phalanx.wire.messages import Message
from phalanx.wire.step_report import AppliedStep


class AgentStatus(msgspec.Struct, array_like=True, frozen=True):
    """One agent as the plant knows it."""

    condition: Condition = Condition.FINE
    step: AppliedStep | None = None
    """Its last one, whose input is in force; null before the first."""
    backups: int = 0
    """Its steps so far at which u_i^min was applied."""
    without_authority: int = 0
    """Its steps so far with empty K_i that kept the nominal input."""
    lies: int = 0
    """False broadcasts that it sent so far."""


class LinkEvent(msgspec.Struct, array_like=True, frozen=True):
    """A link that lost or delayed a broadcast since the frame before."""

    sender: int
    receiver: int
    delay: float
    """[s]; negative: lost."""


def worse(a: float, b: float) -> float:
    """Of two delays [s] the one to show: a loss, which is negative, before any delay."""
    return min(a, b) if min(a, b) < 0.0 else max(a, b)


class LogLine(msgspec.Struct, array_like=True, frozen=True):
    """A line of the event log."""

    t: float
    """[s]"""
    text: str


class Frame(Message, frozen=True, kw_only=True):
    """The run at t; at most some thirty of them a second, and only while somebody looks."""

    t: float
    """[s]"""
    x: bytes
    """Stacked state, little-endian float64."""
    h_tot: float
    """Largest h_tot since the frame before."""
    worst_h: float
    """Largest h_tot so far."""
    pair: int
    """The pair whose h is largest at t: an index into the composed set's pairs."""
    agents: tuple[AgentStatus, ...]
    link_events: tuple[LinkEvent, ...]
    steps: int
    real_time_factor: float
    assumptions: tuple[Assumption, ...]
    violations: tuple[Violation, ...]
    log: tuple[LogLine, ...]
    """The last lines."""
    paused: bool
    speed: float
    """As phalanx.faults.commands.CommandKind.SPEED."""
    loss: float | None
    """Set by a command; null while the scenario's holds."""
    delay: float | None
    """[s], likewise."""


class Setup(Message, frozen=True, kw_only=True):
    """The answer to a viewer that knows the endpoint and the run alone."""

    scenario: bytes
    """The resolved scenario as JSON."""
    commandable: bool
    """Whether the plant obeys commands."""


class CommandMessage(Message, frozen=True, kw_only=True):
    """A viewer to the plant, sealed with the command secret; obeyed at the next event."""

    number: int
    """Larger than that of every command before: a replayed one is refused."""
    command: Command
    """Its t is ignored."""
