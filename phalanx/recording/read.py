"""Read a recording, whole or cut short.

Its sender is not trusted: chunks are unpacked within bounds, and records that are not of the
recorded scenario refused. A few kilobytes of zstd can stand for terabytes, and the file's own word
for how many is not to be believed.
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

from phalanx.arrays import Array
from phalanx.faults.commands import Command
from phalanx.guarantee.verdict import Summary, read_summary
from phalanx.recording.modules import MEDIA_TYPE, MODULES, ModulesError, put_to_use
from phalanx.recording.records import RECORDING, TOPICS, Log, Shown, State, Step
from phalanx.scenario.load import ScenarioError, from_json
from phalanx.scenario.model import Scenario
from phalanx.schema.user_code import code_trusted
from phalanx.theory.expressions.exact import LARGEST_SUM

_MOST_OF_A_CHUNK = 4 * 2**20
"""A chunk is written when it holds 64 kB: one record more makes it longer, and none is so long."""
_LEAST_ALLOWED, _DENSEST = 16 * 2**20, 100
"""All chunks together hold so many bytes, or so many times the file, if that is more."""


class UnreadableRecordingError(ValueError):
    """Not a recording, or damaged before its first chunk ended; the message names the file."""


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
    shown: list[Shown] = field(default_factory=list)
    """Of a run in real time: beside each step, what it was made of."""
    modules: dict[str, str] = field(default_factory=dict)
    """SHA-256 of the user's modules recorded with it, by path."""

    @property
    def unfinished(self) -> str:
        """Why there is no verdict, in words; empty if there is one."""
        return "" if self.summary else self.damage or "it holds no summary"

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


def find(run: Path) -> Path:
    """The recording file of a run folder, or the file itself. Raises UnreadableRecordingError."""
    path = run / RECORDING if run.is_dir() else run
    if not path.is_file():
        raise UnreadableRecordingError(f"{path}: no such recording")
    return path


def read(run: Path, trust: bool = False) -> Recording:
    """Read a run folder or a recording file.

    A file that was cut short gives all records up to its last whole chunk, says so, and has no
    verdict: that is of the whole run, and stands before the last records.

    Args:
        run: the folder or the file.
        trust: whether modules that the recorded scenario names may be imported, which runs them;
            those that this program has imported for a scenario before are, anyway. Those that
            are not here, or differ, are then taken from the recording.

    Raises:
        UnreadableRecordingError: no such file, not MCAP, without a scenario, with one that
            names code that is not trusted, with modules that are not as recorded, or with
            records that are not of its scenario.
    """
    path = find(run)
    contents = _Contents()
    damage = contents.collect(_records_of(path.read_bytes()))
    if contents.scenario is None:
        raise UnreadableRecordingError(f"{path}: not a recording of a run ({damage or 'empty'})")
    try:
        put_to_use(contents.modules, contents.hashes, trust)
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
        by_kind[Command], None if damage else contents.summary, damage, by_kind[Shown],
        contents.hashes,
    )  # fmt: skip
    if unfit := misfit(recording):
        raise UnreadableRecordingError(f"{path}: {unfit}: not of its scenario")
    return recording


def steps_by_agent(recording: Recording) -> dict[str, list[Step]]:
    """Each agent's steps in order, by name, in the scenario's order."""
    found: dict[str, list[Step]] = {name: [] for name, _, _ in recording.scenario.roster()}
    for step in recording.steps:
        found[step.agent].append(step)
    return found


def size_in_words(recording: Recording) -> str:
    """Such as "2.6 MB, 5.1 kB for each agent and second of virtual time"."""
    size = recording.path.stat().st_size
    agents = sum(group.size for group in recording.scenario.agents)
    seconds = recording.states[-1].t if recording.states else 0.0
    total = f"{size / 1e6:.3g} MB"
    if not seconds:
        return total
    each = size / (agents * seconds)
    return f"{total}, {each / 1e3:.3g} kB for each agent and second of virtual time"


def misfit(recording: Recording) -> str | None:
    """The first record that is none of its scenario's, in words: readers rely on sizes and names.

    None if all are.
    """
    roster = recording.scenario.roster()
    dynamics = {name: group.dynamics_object() for name, group, _ in roster}
    width = sum(len(found.states) for found in dynamics.values())
    inputs = {name: len(found.inputs) for name, found in dynamics.items()}
    for state in recording.states:
        if len(state.x) != width:
            return f"a state at t = {state.t:.3f} s of {len(state.x)} numbers, expected {width}"
    for step in recording.steps:
        if not _fits(step, inputs):
            return f"a step of agent {step.agent!r} at t = {step.t:.3f} s with wrong fields"
    sizes = {name: len(found.states) for name, found in dynamics.items()}
    for each in recording.shown:
        if not _could_be_shown(each, sizes, inputs):
            return f"what agent {each.agent!r} was shown at t = {each.t:.3f} s has wrong fields"
    for command in recording.commands:
        if command.effect and command.agent not in dynamics:
            return f"a command at t = {command.t:.3f} s to {command.agent!r}, which is no agent"
    return None


def _fits(step: Step, inputs: dict[str, int]) -> bool:
    size = inputs.get(step.agent)
    told = [sender for sender, *_ in (*step.ages, *step.fates, *step.faults, *step.false)]
    return (
        len(step.u) == size
        and len(step.u_nom) in (0, size)
        and inputs.keys() >= set(told)
        and all(len(u) == inputs[sender] for sender, _, _, u in step.false)
    )


def _could_be_shown(shown: Shown, sizes: dict[str, int], inputs: dict[str, int]) -> bool:
    in_order = [name for name in sizes if name in shown.seen]
    return (
        shown.agent in in_order
        and shown.seen == in_order
        and len(shown.x) == sum(sizes[name] for name in in_order)
        and all(len(u) == inputs.get(sender) for sender, _, u in shown.received)
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
        """Take every record there is; the damage in words, if there is any."""
        kinds = {topic: kind for kind, topic in TOPICS.items()}
        decoders: dict[int, msgspec.json.Decoder[Any]] = {}
        try:
            for record in records:
                if isinstance(record, Channel) and record.topic in kinds:
                    decoders[record.id] = msgspec.json.Decoder(kinds[record.topic])
                elif isinstance(record, Message) and record.channel_id in decoders:
                    found = decoders[record.channel_id].decode(record.data)
                    _require_bounded(record.data)
                    self.records[type(found)].append(found)
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
        except (MemoryError, OverflowError):  # lengths that nothing has
            return f"damaged after {self._extent()}: a length that nothing has"
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
"""What a number of 1e300 or more has in JSON."""


def _require_bounded(record: bytes) -> None:
    """Raise ValueError if a number of a JSON record is too large for figures of it."""
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
    """Every record in order, chunks unpacked and checksums compared.

    Raises what mcap, zstandard and struct do.
    """
    left = max(_LEAST_ALLOWED, _DENSEST * len(file))
    # In memory: where a flipped bit makes a length a terabyte, a file would set that much aside.
    for record in StreamReader(BytesIO(file), emit_chunks=True, validate_crcs=True).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        left -= _unpacked(record)
        if left < 0:
            raise McapError("chunks that unpack to more than a recording holds")
        yield from breakup_chunk(record, validate_crc=True)


def _unpacked(chunk: Chunk) -> int:
    """How many bytes a chunk unpacks to at most. Raises McapError."""
    sizes = [chunk.uncompressed_size]
    if chunk.compression == "zstd":
        # The frame's own word counts for zstd, whatever the chunk says; -1 where it says nothing.
        sizes.append(frame_content_size(chunk.data))
    if max(sizes) > _MOST_OF_A_CHUNK:
        raise McapError(f"a chunk that unpacks to {max(sizes)} bytes")
    return max(sizes)
