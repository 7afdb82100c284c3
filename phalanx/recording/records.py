"""What a recording holds: JSON messages that Foxglove and other MCAP tools read as they are."""

from enum import StrEnum
from typing import Annotated

import msgspec

from phalanx.faults.commands import Command
from phalanx.wire.step_report import AppliedStep

RECORDING = "recording.mcap"
SUMMARY = "summary.json"
PROFILE = "profile"
"""A folder, in a run whose programs were timed."""
SequenceNumber = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""Of a sample or a broadcast; a column of a table holds 64 bits."""


class State(msgspec.Struct):
    """The world at an event: a sample taken or an input applied. Topic /state.

    At every event, or as often as time.recording_step says.
    """

    t: float
    """[s]"""
    x: list[float]
    """Stacked state, shape (n̄,)."""
    h_tot: float
    """Largest h_tot since the state before."""


class Step(AppliedStep, array_like=False, forbid_unknown_fields=False, kw_only=True):
    """One control step of one agent, with all numbers of an AppliedStep. Topic /step."""

    agent: str
    k: SequenceNumber
    t: float
    """t_i^k [s]."""
    t_apply: float
    """When the input took effect [s]."""
    ages: list[tuple[str, float]]
    """(sender, age [s]) of each û_l used."""
    fates: list[tuple[str, SequenceNumber, float]]
    """(sender, sequence number, delay [s]) of broadcasts decided now, or at a step before whose
    input was lost; delay < 0: lost."""
    faults: list[tuple[str, SequenceNumber, list[str]]] = msgspec.field(default_factory=list)
    """(sender, sequence number, names) of those of `fates` in which declared faults had a part."""
    false: list[tuple[str, SequenceNumber, float, list[float]]] = msgspec.field(
        default_factory=list
    )
    """(sender, sequence number, t_apply [s], u) as told, where that is not the truth."""

    def __post_init__(self) -> None:
        """Older recordings have the ages alone."""
        self.oldest_input = max((age for _, age in self.ages), default=None)


class Shown(msgspec.Struct):
    """What an agent was shown, and what it knew, at a step in real time. Topic /shown."""

    agent: str
    k: SequenceNumber
    t: float
    """t_i^k [s]."""
    seen: list[str]
    """The agents that it saw."""
    x: list[float]
    """Their states, stacked in that order."""
    received: list[tuple[str, float, list[float]]]
    """(sender, since when it is held [s], u) of every û_l."""
    adversary: bool = False
    """Whether a command had turned it."""


class Level(StrEnum):
    """How grave an event is."""

    INFO = "info"
    WARNING = "warning"
    """A fault, or a first failure of what a guarantee or the theorem needs."""
    ERROR = "error"
    """A pair left the safe set."""


class Log(msgspec.Struct):
    """An event in words. Topic /log."""

    t: float
    """[s]"""
    text: str
    level: Level = Level.INFO


TOPICS: dict[type, str] = {
    State: "/state",
    Step: "/step",
    Shown: "/shown",
    Log: "/log",
    Command: "/command",
}


def json_schema(kind: type) -> bytes:
    """The JSON Schema of a record, its root inlined as MCAP readers expect."""
    _, components = msgspec.json.schema_components([kind])
    return msgspec.json.encode({"type": "object", **components[kind.__name__]})
