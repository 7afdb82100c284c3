"""What the plant shows to viewers, and what those with the command secret may ask of it."""

import msgspec

from phalanx.faults.commands import Command
from phalanx.faults.state import Condition
from phalanx.guarantee.verdict import Assumption, Violation
from phalanx.theory.rows.origin import Origin
from phalanx.wire.messages import Message


class AgentStatus(msgspec.Struct, array_like=True, frozen=True):
    """One agent as the plant knows it."""

    condition: Condition = Condition.FINE
    u: tuple[float, ...] = ()
    """The input in force, shape (m_i,); empty before the first."""
    u_nom: tuple[float, ...] = ()
    """The nominal input it was made from, shape (m_i,)."""
    origin: Origin = Origin.QP
    backups: int = 0
    """Its steps so far at which u_i^min was applied."""
    without_authority: int = 0
    """Its steps so far with empty K_i that kept the nominal input."""
    residual: float | None = 0.0
    solve_time: float = 0.0
    """Wall time [s]."""
    age: float | None = None
    """Age of the oldest û_l its last step knew [s]; null if it knew none."""
    certified: float | None = None
    """How long all its pairs are proven safe from its last input on [s]; null for an adversary."""
    margin: float | None = None
    """Of its row, as Telemetry has it."""
    lies: int = 0
    """Broadcasts of its so far that told others what was not so."""


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
