"""What happens in a run, in the order in which it is judged; and what ends it early."""

from typing import NamedTuple

from phalanx.arrays import Array
from phalanx.faults.commands import Command
from phalanx.wire.messages import Sample
from phalanx_plant.world.world import Piece


class StateReached(NamedTuple):
    """The world at an event of the schedule."""

    t: float
    """[s]"""
    x: Array
    """Stacked state, shape (n̄,)."""
    way: list[Piece]
    """What the world went through since the event before."""


class Sampled(NamedTuple):
    """An agent took a sample."""

    i: int
    t: float
    """[s]"""
    truthful: bool = True
    """Whether it was told the true state."""


class CommandObeyed(NamedTuple):
    """A command was obeyed."""

    command: Command
    changed: int | None
    """The agent whose condition it changed, if it did."""
    forgotten: tuple[int, ...] = ()
    """Agents whose inputs it had received, and does not know any more."""


class InputApplied(NamedTuple):
    """An actuator took the input that answers sample k."""

    i: int
    k: int
    t: float
    """t_i^k of the sample [s]."""
    t_apply: float
    """[s]"""
    u: Array
    """Native input, shape (m_i,)."""
    x: Array
    """The true stacked state when it took it, shape (n̄,)."""
    answers: Sample | None = None
    """In real time, the sample as the agent was shown it."""


class InputLost(NamedTuple):
    """The input that answers sample k never came to its actuator, which was due to take it at t."""

    i: int
    k: int
    sampled: float
    """t_i^k of the sample [s]."""
    t: float
    """[s]"""
    u: Array
    """Native input, shape (m_i,)."""


class MemberLost(NamedTuple):
    """In real time, agent i is not to be reached from t [s] on, or again if `back`."""

    i: int
    t: float
    """[s]"""
    back: bool


class InstantOver(NamedTuple):
    """Nothing more happens at t: what is shown of it now is what a replay shows."""

    t: float
    """[s]"""


Event = StateReached | Sampled | CommandObeyed | InputApplied | InputLost | MemberLost | InstantOver


class StoppedError(Exception):
    """The user asked the run to stop."""


class AbandonedError(Exception):
    """The process that launched the run is gone, or says that an agent is."""


class SwarmBrokenError(RuntimeError):
    """An agent is missing, dead or silent; the message names it."""
