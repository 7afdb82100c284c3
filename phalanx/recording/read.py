"""Read a recording, whole or cut short.

A recording may come from an attacker: chunks are unpacked within bounds, and records that do not
fit the recorded scenario rejected. A few kilobytes of zstd can unpack to terabytes, and the sizes
in the file may be false.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from zstandard import ZstdError, frame_content_size

from phalanx.faults.commands import Command, turns
from phalanx.guarantee.verdict import Summary, read_summary
from phalanx.recording.modules import MEDIA_TYPE, MODULES, ModulesError, make_importable
from phalanx.recording.records import RECORDING, TOPICS, Log, State, Step, StepData
from phalanx.scenario.load import from_json
from phalanx.scenario.model import Scenario, ScenarioError
from phalanx.schema.user_code import code_trusted
from phalanx.swarm.swarm import Swarm, build_swarm
from phalanx.theory.arrays import Array
from phalanx.theory.expressions.exact import LARGEST_SUM

_LARGEST_CHUNK = 4 * 2**20
"""[bytes]; a chunk is written once it has 64 kB and one record more, which is far smaller."""
_LEAST_ALLOWED, _DENSEST = 16 * 2**20, 100
"""All chunks together may have this many bytes, or this many times the file's, if that is more."""


class UnreadableRecordingError(ValueError):
    """The file is not a recording, or damaged in its first chunk; the message names the file."""


@dataclass
class Recording:
    """A run as recorded."""

    path: Path
    scenario: Scenario
    metadata: dict[str, str]
    states: list[State] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    log: list[Log] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    summary: Summary | None = None
    """The verdict; None of a recording with damage, wherever that is."""
    damage: str | None = None
    """Why the recording ends early, in words; None if it is whole."""
    step_data: list[StepData] = field(default_factory=list)
    """Of a run in real time: the data of each step's decision."""
    modules: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the recorded modules of the user, by path."""

    @property
    def unfinished(self) -> str:
        """The reason why there is no verdict; empty if there is one."""
        return "" if self.summary else self.damage or "it holds no summary"

    @property
    def turns(self) -> dict[int, float]:
        """The time at which each agent that turned adversary did so, by index [s]."""
        names = [name for name, _, _ in self.scenario.roster()]
        return {names.index(name): t for name, t in turns(names, self.commands).items()}

    @property
    def times(self) -> Array:
        """Times of the states [s], shape (s,)."""
        return np.array([state.t for state in self.states])

    @property
    def x(self) -> Array:
        """States, shape (s, n̄)."""
        return np.array([state.x for state in self.states])

    @property
    def h_tot(self) -> Array:
        """Largest h_tot up to each state since the one before, shape (s,)."""
        return np.array([state.h_tot for state in self.states])

    @property
    def h(self) -> Array:
        """Likewise the largest h of a pair with a normal agent; -inf if there is none any more."""
        return np.array([-np.inf if state.h is None else state.h for state in self.states])


def find(run: Path) -> Path:
    """Find the recording file of a run folder or file. Raises UnreadableRecordingError."""
    path = run / RECORDING if run.is_dir() else run
    if not path.is_file():
        raise UnreadableRecordingError(f"{path}: no such recording")
    return path


def read(run: Path, trust: bool = False) -> Recording:
    """Read a run folder or a recording file.

    A file that was cut short gives all records up to its last whole chunk, their damage in words,
    and no verdict, which is of the whole run.

    Args:
        run: the folder or the file.
        trust: allow importing, and so running, the modules that the recorded scenario names; they
            come from the recording if none are found, or others. Modules that this program has
            imported for a scenario before need no trust.

    Raises:
        UnreadableRecordingError: the file does not exist, is not MCAP, has no scenario or one
            that names code that is not trusted, modules that differ from their hashes, or records
            that do not fit its scenario.
    """
    path = find(run)
    contents = _Contents()
    damage = contents.collect(_records_of(path.read_bytes()))
    if contents.scenario is None:
        raise UnreadableRecordingError(f"{path}: not a recording of a run ({damage or 'empty'})")
    try:
        make_importable(contents.modules, contents.hashes, trust)
        with code_trusted(trust):
            scenario = from_json(contents.scenario)
    except ModulesError as error:
        raise UnreadableRecordingError(f"{path}: {error}") from error
    except ScenarioError as error:
        with_it = f" (recorded with it: {', '.join(contents.modules)})" if contents.modules else ""
        raise UnreadableRecordingError(f"{path}: {error}{with_it}") from error
    by_kind: dict[type, list[Any]] = contents.records
    recording = Recording(
        path, scenario, contents.metadata, by_kind[State], by_kind[Step], by_kind[Log],
        by_kind[Command], None if damage else contents.summary, damage, by_kind[StepData],
        contents.hashes,
    )  # fmt: skip
    if unfit := misfit(recording):
        raise UnreadableRecordingError(f"{path}: {unfit}: not of its scenario")
    return recording


def swarm_of(recording: Recording) -> Swarm:
    """Build the recorded scenario's swarm. Raises UnreadableRecordingError."""
    try:
        return build_swarm(recording.scenario)
    except ScenarioError as error:
        raise UnreadableRecordingError(f"{recording.path}: {error}") from error


def steps_by_agent(recording: Recording) -> dict[str, list[Step]]:
    """Return each agent's steps in order, by name, in the scenario's order."""
    steps: dict[str, list[Step]] = {name: [] for name, _, _ in recording.scenario.roster()}
    for step in recording.steps:
        steps[step.agent].append(step)
    return steps


def size_in_words(recording: Recording) -> str:
    """Describe a size, as "2.6 MB, 5.1 kB for each agent and second of virtual time"."""
    size = recording.path.stat().st_size
    agents = sum(group.size for group in recording.scenario.agents)
    seconds = recording.states[-1].t if recording.states else 0.0
    total = f"{size / 1e6:.3g} MB"
    if not seconds:
        return total
    rate = size / (agents * seconds)
    return f"{total}, {rate / 1e3:.3g} kB for each agent and second of virtual time"


def misfit(recording: Recording) -> str | None:
    """Describe the first record whose sizes or names do not fit the scenario; None if all do."""
    roster = recording.scenario.roster()
    dynamics = {name: group.dynamics_object() for name, group, _ in roster}
    width = sum(len(model.states) for model in dynamics.values())
    inputs = {name: len(model.inputs) for name, model in dynamics.items()}
    for state in recording.states:
        if len(state.x) != width:
            return f"a state at t = {state.t:.3f} s of {len(state.x)} numbers, expected {width}"
    sizes = {name: len(model.states) for name, model in dynamics.items()}
    for step in recording.steps:
        if not _fits(step, inputs, sizes):
            return f"a step of agent {step.agent!r} at t = {step.t:.3f} s with wrong fields"
    for data in recording.step_data:
        if not _could_be_shown(data, sizes, inputs):
            return f"what agent {data.agent!r} was shown at t = {data.t:.3f} s has wrong fields"
    for command in recording.commands:
        if command.effect and command.agent not in dynamics:
            return f"a command at t = {command.t:.3f} s to {command.agent!r}, which is no agent"
    return None


def _fits(step: Step, inputs: dict[str, int], sizes: dict[str, int]) -> bool:
    size = inputs.get(step.agent)
    named = (*step.ages, *step.fates, *step.faults, *step.false, *step.false_states)
    senders = [sender for sender, *_ in named]
    return (
        len(step.u) == size
        and len(step.u_nom) in (0, size)
        and inputs.keys() >= set(senders)
        and all(len(u) == inputs[sender] for sender, _, _, u in step.false)
        and all(len(x) == sizes[sender] for sender, _, x in step.false_states)
    )


def _could_be_shown(data: StepData, sizes: dict[str, int], inputs: dict[str, int]) -> bool:
    in_order = [name for name in sizes if name in data.seen]
    return (
        data.agent in in_order
        and data.seen == in_order
        and len(data.x) == sum(sizes[name] for name in in_order)
        and all(len(u) == inputs.get(sender) for sender, _, u in data.received)
    )


class _Contents:
    def __init__(self) -> None:
        self.scenario: str | None = None
        self.summary: Summary | None = None
        self.metadata: dict[str, str] = {}
        self.modules: dict[str, bytes] = {}
        self.hashes: dict[str, str] = {}
        self.records: dict[type, list[Any]] = {kind: [] for kind in TOPICS}

    def collect(self, records: Iterator[McapRecord]) -> str | None:
        """Collect all records; return the damage in words, if there is any."""
        kinds = {topic: kind for kind, topic in TOPICS.items()}
        decoders: dict[int, msgspec.json.Decoder[Any]] = {}
        newest: dict[str | None, float] = {}  # of the states, and of each agent's steps
        try:
            for record in records:
                if isinstance(record, Channel) and record.topic in kinds:
                    decoders[record.id] = msgspec.json.Decoder(kinds[record.topic])
                elif isinstance(record, Message) and record.channel_id in decoders:
                    value = decoders[record.channel_id].decode(record.data)
                    _require_bounded(record.data)
                    if isinstance(value, State | Step):
                        of = getattr(value, "agent", None)
                        if value.t < (t := newest.setdefault(of, value.t)):
                            raise ValueError(f"a record of t = {value.t:g} s after one of {t:g} s")
                        newest[of] = value.t
                    self.records[type(value)].append(value)
                elif isinstance(record, Metadata) and record.name == "phalanx":
                    self.metadata = record.metadata
                elif isinstance(record, Metadata) and record.name == MODULES:
                    self.hashes = record.metadata
                elif isinstance(record, Attachment):
                    self._attach(record)
        except (EndOfFile, struct.error):
            return f"cut short after {self._extent()}"
        except (McapError, CRCValidationError, ZstdError, msgspec.DecodeError, ValueError) as error:
            return f"damaged after {self._extent()}: {error}"
        except (MemoryError, OverflowError):
            return f"damaged after {self._extent()}: an impossible length"
        return None

    def _attach(self, record: Attachment) -> None:
        if record.name == "scenario.json":
            self.scenario = record.data.decode()
        elif record.name == "summary.json":
            self.summary = read_summary(record.data)
        elif record.media_type == MEDIA_TYPE:
            self.modules[record.name] = record.data

    def _extent(self) -> str:
        states = self.records[State]
        return f"t = {states[-1].t:.3f} s" if states else "no state"


_ENORMOUS = re.compile(rb"e\+?0*3\d\d|\d{300}", re.IGNORECASE)
"""A part of every JSON number of 1e300 or more."""


def _require_bounded(record: bytes) -> None:
    """Raise ValueError if a number of a JSON record is too large to compute with."""
    if _ENORMOUS.search(record) and _beyond(msgspec.json.decode(record)):
        raise ValueError(f"a number above {LARGEST_SUM:g}, which no run has")


def _beyond(value: Any) -> bool:
    match value:
        case list():
            return any(map(_beyond, value))
        case dict():
            return any(map(_beyond, value.values()))
        case float() | int():
            return abs(value) > LARGEST_SUM
    return False


def _records_of(file: bytes) -> Iterator[McapRecord]:
    """Yield every record in order, chunks unpacked and checksums compared.

    Raises the errors of mcap, zstandard and struct.
    """
    allowance = max(_LEAST_ALLOWED, _DENSEST * len(file))
    # From memory: reading a damaged length of a terabyte from a file would allocate as much.
    for record in StreamReader(BytesIO(file), emit_chunks=True, validate_crcs=True).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        allowance -= _unpacked(record)
        if allowance < 0:
            raise McapError("chunks that unpack to more than a recording holds")
        yield from breakup_chunk(record, validate_crc=True)


def _unpacked(chunk: Chunk) -> int:
    """Return the most bytes that a chunk unpacks to. Raises McapError."""
    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        # zstd goes by the size in its frame, which is -1 if unknown.
        sizes.append(frame_content_size(chunk.data))
    if max(sizes) > _LARGEST_CHUNK:
        raise McapError(f"a chunk that unpacks to {max(sizes)} bytes")
    return max(sizes)
