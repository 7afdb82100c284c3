"""Messages between the programs of a run, each an array of msgpack; see docs/wire.md.

An agent answers a sample with three messages: an Actuation for its actuator, a Broadcast for each
peer, and Telemetry for the plant's recording. Messages of viewers follow.
"""

import math
from typing import Annotated, ClassVar

import msgspec

from phalanx.faults.commands import ActiveCommands, Command, Condition
from phalanx.guarantee.verdict import Assumption, Violation
from phalanx.messages.step_report import AppliedStep, StepReport
from phalanx.network.inbox import Conviction, DeliveryReport
from phalanx.theory.expressions.exact import LARGEST, LARGEST_SUM
from phalanx.theory.laws.law import LONGEST_NAME, MOST_NOTES

VERSION = 4
MAX_BYTES = 65_536
"""Larger payloads are dropped unread."""
LONGEST_FAILURE = 2_000
"""Most characters of the reason why an agent failed."""
SAYS = "failed; it says: "
"""Comes before an agent's own words, quoted, in the reason of a verdict."""

Note = tuple[Annotated[str, msgspec.Meta(max_length=LONGEST_NAME)], float]


class Message(
    msgspec.Struct, array_like=True, forbid_unknown_fields=True, frozen=True, kw_only=True
):
    """Common head of every message."""

    largest: ClassVar[float] = math.inf
    """Largest absolute value of a valid number, which then excludes NaN; infinite: no check."""

    version: int = VERSION


class StepFailedError(RuntimeError):
    """A sample cannot be answered; the message names the code that failed, where and how."""

    def __init__(self, message: str, sample: "Sample") -> None:
        super().__init__(message)
        self.sample = sample


class Sample(Message, frozen=True, kw_only=True):
    """Plant to agent i at its sampling instant: the states that it sees."""

    k: int
    t: Annotated[float, msgspec.Meta(ge=0.0, le=1e300)]
    """t_i^k [s]."""
    seen: tuple[int, ...]
    """Indices of the agents that it sees, itself among them, in order."""
    x: bytes
    """Their states, stacked in that order, little-endian float64."""
    since: tuple[int, ...]
    """For each of them, the sequence number of the first of its broadcasts that count; -1 if none
    does."""
    latest: tuple[int, ...]
    """For each of them, that of the last one before t: all from `since` on were put to agent i."""
    hearers: tuple[int, ...]
    """Indices of those among them that get agent i's broadcast: they see it too, and listen."""
    commands: ActiveCommands | None = None
    pace: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] | None = None
    """In real time, seconds of virtual time per second of wall time: the agent answers with the
    broadcasts that have come. Null in lockstep: it waits for all that count."""


def last_sample(i: int, k: int, t: float, x: bytes) -> Sample:
    """Make the sample at which agent i's process has to kill itself."""
    itself, nothing = (i,), (-1,)
    return Sample(
        k=k, t=t, seen=itself, x=x, since=nothing, latest=nothing, hearers=(),
        commands=ActiveCommands(die=True),
    )  # fmt: skip


class Actuation(Message, frozen=True, kw_only=True):
    """Agent i to its actuator, which is in the plant: the input it holds from t_apply on."""

    largest: ClassVar[float] = LARGEST

    k: int
    """Of the sample that it answers."""
    t_apply: float
    """[s]"""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""


class Broadcast(Message, frozen=True, kw_only=True):
    """Agent i to one of its peers: the input that it claims to hold from t_apply on."""

    largest: ClassVar[float] = LARGEST

    k: int
    """Its sequence number."""
    t_apply: float
    """[s]"""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""


class Telemetry(Message, frozen=True, kw_only=True):
    """Agent i to the plant, for the recording and the viewers: how an input was made."""

    largest: ClassVar[float] = LARGEST_SUM

    k: int
    """Of the sample that was answered."""
    report: StepReport
    ages: tuple[tuple[int, float], ...]
    """(agent's index, age [s]) of each û_l that its row used."""
    fates: tuple[DeliveryReport, ...] = ()
    """Fates of broadcasts that were decided since the last report."""
    rejected: int = 0
    """Payloads dropped by this agent so far."""
    received: tuple[tuple[int, float, tuple[float, ...]], ...] = ()
    """In real time, (agent's index, t_apply [s], u) of every û_l that the agent had."""
    convictions: tuple[Conviction, ...] = ()
    """The new ones."""
    failed: Annotated[str, msgspec.Meta(max_length=LONGEST_FAILURE)] = ""
    """Why neither this sample nor a later one is answered; the other fields then mean nothing."""
    notes: Annotated[tuple[Note, ...], msgspec.Meta(max_length=MOST_NOTES)] = ()
    """(name, number) of what another controller than the paper's wants recorded."""


class Status(Message, frozen=True, kw_only=True):
    """Plant to everyone, a few times a second: progress of the run."""

    t: float = 0.0
    """[s]"""
    real_time_factor: float = 0.0
    worst_h: float | None = None
    """Largest h of a pair with a normal agent so far; null before the first."""
    steps: int = 0
    backups: int = 0
    """Steps of normal agents at which u_i^min was applied."""
    waiting_for: tuple[str, ...] = ()
    """Agents that have not joined yet."""
    restart: bool = False
    """Whether these have died, and their launcher is to start them again."""
    stopped: tuple[str, ...] = ()
    """Agents that are paused: their launcher is to suspend their processes by SIGSTOP."""


class Ended(Message, frozen=True, kw_only=True):
    """Plant to everyone, once: the run's summary as JSON."""

    summary: bytes


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
