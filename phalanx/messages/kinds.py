"""Messages between the programs of a run, each an array of msgpack; see docs/wire.md.

An agent answers a sample with three messages: an Actuation for its actuator, a Broadcast for each
peer, and Telemetry for the plant's recording. phalanx.messages.frames has those of viewers.
"""

import math
from typing import Annotated, ClassVar

import msgspec

from phalanx.faults.commands import ActiveCommands
from phalanx.messages.step_report import StepReport
from phalanx.network.inbox import Conviction, DeliveryReport, Statement
from phalanx.theory.expressions.exact import LARGEST, LARGEST_SUM
from phalanx.theory.laws.law import LONGEST_NAME, MOST_NOTES

VERSION = 5
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
    senders: tuple[int, ...] = ()
    """Indices of the agents whose broadcasts count."""
    since: tuple[int, ...] = ()
    """For each sender, the sequence number of the first of its broadcasts that count."""
    latest: tuple[int, ...] = ()
    """For each sender, that of the last one before t: all from `since` on were put to agent i."""
    hearers: tuple[int, ...]
    """Indices of those that get agent i's broadcast: they see it too, and listen; or by radio."""
    distances: tuple[float, ...] = ()
    """To each sender [m], for the rules of links; empty if it sees them all."""
    commands: ActiveCommands | None = None
    pace: Annotated[float, msgspec.Meta(ge=0.0, le=1e6)] | None = None
    """In real time, seconds of virtual time per second of wall time: the agent answers with the
    broadcasts that have come. Null in lockstep: it waits for all that count."""


def last_sample(i: int, k: int, t: float, x: bytes) -> Sample:
    """Make the sample at which agent i's process has to kill itself."""
    return Sample(
        k=k, t=t, seen=(i,), x=x, hearers=(),
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
    """Agent i to one of its peers: its statement, which may be a lie, and those of others."""

    largest: ClassVar[float] = LARGEST

    k: int
    """Number of the sample that it answers."""
    t_apply: float
    """Time from which it claims to hold the input [s]."""
    u: tuple[float, ...]
    """Native input, shape (m_i,)."""
    t: float = 0.0
    """Time of the sample [s]; by radio."""
    x: tuple[float, ...] = ()
    """State at the sample, shape (n_i,); by radio."""
    z: tuple[float, ...] = ()
    """Reference state at the sample, shape (n_i,); by radio."""
    relays: tuple[Statement, ...] = ()
    """Statements of others, as agent i has received them; by radio."""


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
