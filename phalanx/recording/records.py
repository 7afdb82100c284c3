"""Records of a recording: JSON messages that Foxglove and other MCAP tools can read."""

from enum import StrEnum
from typing import Annotated

import msgspec

from phalanx.faults.commands import Command
from phalanx.messages.step_report import AppliedStep

RECORDING = "recording.mcap"
SUMMARY = "summary.json"
SequenceNumber = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""Of a sample or a broadcast; fits into a table's column of 64 bits."""


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
    h: float | None = None
    """Likewise the largest h of a pair with a normal agent; None if there is none any more."""


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
    """(sender, sequence number, delay [s]) of broadcasts decided now, or at an earlier step whose
    input was lost; delay < 0: lost."""
    faults: list[tuple[str, SequenceNumber, list[str]]] = msgspec.field(default_factory=list)
    """(sender, sequence number, names) of those of `fates` that declared faults affected."""
    false: list[tuple[str, SequenceNumber, float, list[float]]] = msgspec.field(
        default_factory=list
    )
    """(sender, sequence number, t_apply [s], u) of false claims."""
    false_states: list[tuple[str, SequenceNumber, list[float]]] = msgspec.field(
        default_factory=list
    )
    """(sender, sequence number, x) of the same by radio."""
    notes: dict[str, float] = msgspec.field(default_factory=dict)
    """Numbers that a controller of one's own wants recorded, by name."""

    def __post_init__(self) -> None:
        """Compute the oldest age where it is missing, as in older recordings."""
        if self.ages and self.oldest_input is None:
            self.oldest_input = max([age for _, age in self.ages])


class StepData(msgspec.Struct):
    """The data of an agent's decision at a step in real time. Topic /shown."""

    agent: str
    k: SequenceNumber
    t: float
    """t_i^k [s]."""
    seen: list[str]
    """The agents that it saw."""
    x: list[float]
    """Their states, stacked in that order."""
    received: list[tuple[str, float, list[float]]]
    """(sender, t_apply [s], u) of every û_l."""
    adversary: bool = False
    """Whether a command had made it an adversary."""


class Level(StrEnum):
    """The severity of an event."""

    INFO = "info"
    WARNING = "warning"
    """A fault, or a first failure of what a guarantee or the theorem needs."""
    ERROR = "error"
    """A pair left the safe set."""


class Log(msgspec.Struct):
    """A line of the event log. Topic /log."""

    t: float
    """[s]"""
    text: str
    level: Level = Level.INFO
    pair: str = ""
    """The pair that left the safe set, or is safe again."""


TOPICS: dict[type, str] = {
    State: "/state",
    Step: "/step",
    StepData: "/shown",
    Log: "/log",
    Command: "/command",
}


def json_schema(kind: type) -> bytes:
    """Return the JSON Schema of a record, its root inlined as MCAP readers expect."""
    _, components = msgspec.json.schema_components([kind])
    root = components[kind.__name__] | {"title": schema_name(kind)}
    return msgspec.json.encode({"type": "object", **root})


def schema_name(kind: type) -> str:
    """Return the name of a record's schema, which follows from its topic."""
    return TOPICS[kind].removeprefix("/").capitalize()
