"""Messages of viewers: the run in frames, its scenario, and commands. No agent reads them."""

import msgspec

from phalanx.faults.commands import Command, Condition
from phalanx.guarantee.verdict import Assumption, Violation
from phalanx.messages.kinds import Message
from phalanx.messages.step_report import AppliedStep
from phalanx.network.inbox import Statement


class AgentStatus(msgspec.Struct, array_like=True, frozen=True):
    """The plant's knowledge of one agent."""

    condition: Condition = Condition.FINE
    step: AppliedStep | None = None
    """Its last step, whose input is in force; null before the first."""
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
    """Return the worse of two delays [s]; a loss, which is negative, is worse than any delay."""
    return min(a, b) if min(a, b) < 0.0 else max(a, b)


class LogLine(msgspec.Struct, array_like=True, frozen=True):
    """A line of the event log."""

    t: float
    """[s]"""
    text: str


class Frame(Message, frozen=True, kw_only=True):
    """The run at t; at most some thirty a second, and only while a viewer is connected."""

    t: float
    """[s]"""
    x: bytes
    """Stacked state, little-endian float64."""
    h_tot: float
    """Largest h_tot since the state before."""
    h: float
    """Likewise the largest h of a pair with a normal agent."""
    worst_h: float
    """The largest so far."""
    pair: int
    """The pair with a normal agent whose h is largest at t, as an index into all pairs."""
    turned: tuple[int, ...]
    """Agents that became adversaries: pairs without a normal agent no longer count."""
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
    statements: tuple[tuple[int, Statement], ...] = ()
    """By radio: agents, and what came to them since the frame before; each second all they know."""


class Setup(Message, frozen=True, kw_only=True):
    """The plant's answer to a viewer's query."""

    scenario: bytes
    """The resolved scenario as JSON."""
    commandable: bool
    """Whether the plant obeys commands."""
    real_time: bool
    """Whether virtual time follows the wall clock, which has no speed 0."""


class CommandMessage(Message, frozen=True, kw_only=True):
    """A viewer to the plant, sealed with the command secret; obeyed at the next event."""

    number: int
    """Larger than that of every earlier command: a replayed one is dropped."""
    command: Command
    """Its t is ignored."""
