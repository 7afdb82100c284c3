"""Write a recording during the run."""

import json
import os
import platform
import struct
from collections import defaultdict
from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import msgspec
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import MessageIndex
from mcap.writer import Writer

from phalanx.faults.commands import Command
from phalanx.guarantee.verdict import Outcome, Summary
from phalanx.native.files import whole_file
from phalanx.recording.modules import MEDIA_TYPE, MODULES, ModulesError, hashes
from phalanx.recording.records import TOPICS, Log, State, Step, StepData, json_schema, schema_name
from phalanx.scenario.model import Scenario, digest, to_json
from phalanx.schema.user_code import imported_sources

_CHUNK_BYTES = 64 * 1024
_HEAD = struct.Struct("<BQHIQQ")
_LENGTH = _HEAD.size - 9
"""Of a message's record without its data, after operation code and length [bytes]."""
_VERSIONS = ("eclipse-zenoh", "osqp", "casadi", "numpy")

Record = State | Step | StepData | Log | Command


class RecordingError(OSError):
    """The recording cannot be written: the disk is full, or the file is gone."""


class RecordingWriter(AbstractContextManager["RecordingWriter"]):
    """One MCAP file; every chunk is written completely before the next begins."""

    def __init__(self, path: Path, scenario: Scenario, run_id: str) -> None:
        """Create the file, with versions, the user's modules and the resolved scenario first."""
        self._file = _WholeWrites(path)
        self._writer = PackedWriter(self._file, _CHUNK_BYTES)
        self._writer.start(profile="", library=f"phalanx {version('phalanx-swarm')}")
        self._encode = msgspec.json.Encoder().encode
        self._writer.add_metadata(
            "phalanx",
            {
                "run": run_id,
                "seed": str(scenario.seed),
                "scenario_digest": digest(scenario),
                "date": datetime.now(UTC).isoformat(timespec="seconds"),
                "python": platform.python_version(),
                "phalanx": version("phalanx-swarm"),
                **{name: version(name) for name in _VERSIONS},
            },
        )
        table = to_json(scenario)
        without_modules = self._add_modules(imported_sources(json.loads(table)))
        self._writer.add_attachment(0, 0, "scenario.json", "application/json", table.encode())
        self._channels = {}
        for kind, topic in TOPICS.items():
            schema = self._writer.register_schema(
                f"phalanx.{schema_name(kind)}", "jsonschema", json_schema(kind)
            )
            self._channels[kind] = self._writer.register_channel(topic, "json", schema)
        if without_modules:
            self.write(Log(0.0, f"recorded without the user's code: {without_modules}"))

    def write(self, *records: Record) -> None:
        """Append records at their virtual times. Raises RecordingError."""
        channels, encode = self._channels, self._encode
        self._writer.add([(channels[type(r)], int(r.t * 1e9), encode(r)) for r in records])

    def finish(self, summary: Summary) -> None:
        """Append the summary and the index. Raises RecordingError."""
        self._writer.add_attachment(
            0, 0, "summary.json", "application/json", msgspec.json.encode(summary)
        )
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _add_modules(self, modules: Mapping[str, bytes]) -> str:
        """Attach all of a user's modules; if that fails none, and return the reason."""
        try:
            digests = hashes(modules)
        except ModulesError as error:
            return str(error)
        if digests:
            self._writer.add_metadata(MODULES, digests)
        for path, source in modules.items():
            self._writer.add_attachment(0, 0, path, MEDIA_TYPE, source)
        return ""

    def close(self) -> None:
        """Close the file, which is readable even without `finish`."""
        self._file.close()

    def __exit__(self, *_: object) -> None:
        self.close()


def write_summary(summary: Summary, file: Path, recording: RecordingWriter) -> None:
    """Write the summary to its file and into the recording, which it finishes.

    On failure the summary's outcome becomes BROKEN, and the file is removed.
    """
    # It appears last, by a rename, which needs no space: if it exists, the recording is complete.
    try:
        with whole_file(file) as part:
            part.write_bytes(msgspec.json.encode(summary))
            recording.finish(summary)
    except OSError as error:
        if summary.outcome is not Outcome.BROKEN:
            summary.reason = f"{summary.outcome}, but not written down to its end: {error}"
        summary.outcome = Outcome.BROKEN


class _WholeWrites:
    """A file that writes all of each block of data or nothing, and nothing after a failure."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._end = 0
        self._failure: RecordingError | None = None
        try:
            self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        except OSError as error:
            raise RecordingError(error.errno, f"{error.strerror}: {path}") from error

    def write(self, data: bytes) -> int:
        if self._failure:
            raise self._failure
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[os.write(self._fd, rest) :]
        except OSError as error:
            # Half a chunk would hide the whole ones behind it from a strict reader.
            os.ftruncate(self._fd, self._end)
            self._failure = RecordingError(error.errno, f"{error.strerror}: {self._path}")
            raise self._failure from error
        self._end += len(data)
        return len(data)

    def tell(self) -> int:
        return self._end

    def close(self) -> None:
        os.close(self._fd)


class _PackedIndex(MessageIndex):
    """The index of a chunk's messages, written at once: a time and an offset for each."""

    def write(self, stream: RecordBuilder) -> None:
        numbers: list[Any] = self.records
        size = 8 * len(numbers)
        head = struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + size, self.channel_id, size)
        stream.write(head + struct.pack(f"<{len(numbers)}Q", *numbers))


class PackedWriter(Writer):
    """A writer that makes its files with few calls for each message, with the same bytes.

    mcap writes each field of a message by calls of its own: a quarter of a plant's calls in a step.
    Upstream: mcap 1.6, `mcap.writer.Writer.add_message`, `mcap.records.Message.write`,
    `mcap.records.MessageIndex.write` and `mcap._chunk_builder`.
    """

    def __init__(self, output: Any, chunk_size: int) -> None:
        super().__init__(output, chunk_size=chunk_size, enable_data_crcs=True)
        self._chunk: Any = self._Writer__chunk_builder  # type: ignore[attr-defined]
        self._most = chunk_size
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._index: defaultdict[int, list[int]] = defaultdict(list)
        """By channel, time [ns] and offset of each message, one after the other."""
        self._size = 0
        """Of the messages [bytes]."""

    def add(self, messages: Iterable[tuple[int, int, bytes]]) -> None:
        """Append messages: channel, time [ns] and data of each."""
        for channel, at, data in messages:
            if not self._parts:
                self._size = self._chunk.count
            size = _LENGTH + len(data)
            self._parts += _HEAD.pack(Opcode.MESSAGE, size, channel, 0, at, at), data
            self._index[channel] += at, self._size
            self._size += 9 + size
            if self._size > self._most:
                self._Writer__finalize_chunk()

    def _Writer__finalize_chunk(self) -> None:  # noqa: N802
        """Hand the chunk's messages to the library, which writes it, and count them."""
        if not self._parts:
            return
        chunk, statistics = self._chunk, self._Writer__statistics  # type: ignore[attr-defined]
        chunk.record_writer.write(b"".join(self._parts))
        times = [at for numbers in self._index.values() for at in numbers[::2]]
        chunk.message_start_time, chunk.message_end_time = min(times), max(times)
        chunk.num_messages = len(times)
        if not statistics.message_count:  # a run's first record is of its start
            statistics.message_start_time = min(times)
        statistics.message_end_time = max(statistics.message_end_time, max(times))
        statistics.message_count += len(times)
        for channel, numbers in self._index.items():
            chunk.message_indices[channel] = _PackedIndex(channel, numbers)  # type: ignore[arg-type]
            statistics.channel_message_counts[channel] += len(numbers) // 2
        self._begin_chunk()
        super()._Writer__finalize_chunk()  # type: ignore[misc]
