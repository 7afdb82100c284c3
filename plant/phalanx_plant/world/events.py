"""The events of a run, in the order in which they are judged; and the errors that end it early."""

from collections.abc import Sequence

from msgspec import Struct

from phalanx.faults.commands import Command
from phalanx.messages.kinds import Sample, Telemetry
from phalanx.theory.arrays import Array
from phalanx_plant.world.world import History


class StateReached(Struct, frozen=True):
    """The world reached the time of an event."""

    t: float
    """[s]"""
    x: Array
    """Stacked state, shape (n̄,)."""
    history: History
    """The motion since the previous such event."""


class Sampled(Struct, frozen=True):
    """An agent took a sample."""

    i: int
    t: float
    """[s]"""
    truthful: bool = True
    """Whether its sensors measured the true state."""


class CommandApplied(Struct, frozen=True):
    """A command took effect."""

    command: Command
    changed: int | None
    """The agent whose condition it changed, if any."""
    forgotten: tuple[int, ...] = ()
    """Agents whose received inputs that agent lost."""


class InputApplied(Struct, frozen=True):
    """An actuator applied the input that answers sample k."""

    i: int
    k: int
    t_sample: float
    """t_i^k [s]."""
    t_apply: float
    """[s]"""
    u: Array
    """Native input, shape (m_i,)."""
    answers: Sample | None = None
    """In real time, the sample as the agent received it."""
    telemetry: Telemetry | None = None
    """The agent's report on its sample k; None until that is awaited."""


class InputLost(Struct, frozen=True):
    """The input that answers sample k never reached its actuator."""

    i: int
    k: int
    t_sample: float
    """t_i^k [s]."""
    t_due: float
    """When it was due, or, in real time, had come from its agent if that is later [s]."""
    u: Array
    """Native input, shape (m_i,)."""
    telemetry: Telemetry | None = None
    """As of an InputApplied."""


class MemberLost(Struct, frozen=True):
    """Agent i became unreachable at t [s], in real time, or reachable again if `back`."""

    i: int
    t: float
    """[s]"""
    back: bool
    why: str = ""
    """What it reported before it became unreachable."""


Event = StateReached | Sampled | CommandApplied | InputApplied | InputLost | MemberLost
Instant = Sequence[Event]
"""All events of an instant, in order: a frame of then equals a frame of a replay."""


class StoppedError(Exception):
    """The user stopped the run."""


class AbandonedError(Exception):
    """The process that launched the run ended, or reports that an agent did."""


class SwarmBrokenError(RuntimeError):
    """An agent is missing, dead or silent; the message names it."""
